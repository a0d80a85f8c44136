#include "anigen/eval/comparison/comparison_files.h"

namespace anigen::eval {
namespace {

std::string latex_escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    switch (c) {
      case '\\':
        result += "\\textbackslash{}";
        break;
      case '~':
        result += "\\textasciitilde{}";
        break;
      case '^':
        result += "\\textasciicircum{}";
        break;
      case '&':
      case '%':
      case '$':
      case '#':
      case '_':
      case '{':
      case '}':
        result += '\\';
        result += c;
        break;
      default:
        result += c;
    }
  }
  return result;
}

std::string latex_head(const MetricInfo& metric) {
  std::string head = latex_escaped(metric.label);
  if (metric.better == Better::kLower) head += " $\\downarrow$";
  if (metric.better == Better::kHigher) head += " $\\uparrow$";
  return head;
}

void add_section(std::string& text, const std::string& title, const Table& table) {
  if (!table.rows.empty()) text += "\n## " + title + "\n\n" + to_markdown(table);
}

}  // namespace

std::string to_markdown(const Comparison& comparison) {
  std::string text = "# " + std::to_string(comparison.ids.size()) + " ground truths\n\n" +
                     to_markdown(method_table(comparison, present_metrics(comparison, true)));
  if (comparison.methods.size() > 1)
    text += "\nBest in bold, second best in italics; methods with values on different assets are not ranked.\n";
  add_section(text, "Differences to " + comparison.methods[0], difference_table(comparison));
  for (std::size_t m = 0; m < comparison.methods.size(); ++m)
    add_section(text, "All metrics, " + comparison.methods[m], metric_summary_table(comparison, m));
  add_section(text, "Not computed", reason_table(comparison));
  if (!comparison.unused.empty()) {
    text += "\nPredictions without a ground truth: " + std::to_string(comparison.unused.size()) + " (";
    for (std::size_t i = 0; i < comparison.unused.size() && i < 10; ++i)
      text += (i > 0 ? ", " : "") + comparison.unused[i];
    text += comparison.unused.size() > 10 ? ", …)\n" : ")\n";
  }
  return text;
}

std::string to_latex(const Comparison& comparison) {
  const std::vector<const MetricInfo*> metrics = present_metrics(comparison, true);
  std::string text =
      "% needs \\usepackage{booktabs}\n\\begin{tabular}{l" + std::string(metrics.size(), 'r') + "}\n\\toprule\nMethod";
  for (const MetricInfo* metric : metrics) text += " & " + latex_head(*metric);
  text += " \\\\\n\\midrule\n";
  const Table table = method_table(comparison, metrics);
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    text += latex_escaped(comparison.methods[m]);
    for (std::size_t c = 0; c < metrics.size(); ++c) {
      std::string cell = table.rows[m][c + 3];
      if (cell == "–") {
        text += " & --";
      } else if (cell.rfind("**", 0) == 0) {
        text += " & \\textbf{" + cell.substr(2, cell.size() - 4) + "}";
      } else if (cell.front() == '_') {
        text += " & \\underline{" + cell.substr(1, cell.size() - 2) + "}";
      } else {
        text += " & " + cell;
      }
    }
    text += " \\\\\n";
  }
  return text + "\\bottomrule\n\\end{tabular}\n";
}

}  // namespace anigen::eval
