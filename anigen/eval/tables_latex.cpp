#include "anigen/eval/tables.h"

namespace anigen::eval {
namespace {

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '\\') {
      result += "\\textbackslash{}";
    } else if (c == '~') {
      result += "\\textasciitilde{}";
    } else if (c == '^') {
      result += "\\textasciicircum{}";
    } else {
      if (std::string("&%$#_{}").find(c) != std::string::npos) result += '\\';
      result += c;
    }
  }
  constexpr const char* kSigns[][2] = {
      {"±", "$\\pm$"}, {"↓", "$\\downarrow$"}, {"↑", "$\\uparrow$"}, {"–", "--"}, {"…", "\\dots{}"}};
  for (const auto& [sign, latex] : kSigns) {
    const std::string from = sign, to = latex;
    for (std::size_t at = result.find(from); at != std::string::npos; at = result.find(from, at + to.size()))
      result.replace(at, from.size(), to);
  }
  return result;
}

std::string cell_of(const std::string& cell) {
  const MarkedCell marked = without_marks(cell);
  const std::string text = escaped(marked.text);
  if (marked.place == 1) return "\\textbf{" + text + "}";
  return marked.place == 2 ? "\\underline{" + text + "}" : text;
}

std::string line_of(const std::vector<std::string>& cells) {
  std::string line;
  for (std::size_t i = 0; i < cells.size(); ++i) line += (i > 0 ? " & " : "") + cell_of(cells[i]);
  return line + " \\\\\n";
}

}  // namespace

std::string to_latex(const Table& table) {
  if (table.columns.empty()) return "";
  std::string text = "% needs \\usepackage{booktabs}\n\\begin{tabular}{l" +
                     std::string(table.columns.size() - 1, 'r') + "}\n\\toprule\n" + line_of(table.columns) +
                     "\\midrule\n";
  for (const auto& row : table.rows) text += line_of(row);
  return text + "\\bottomrule\n\\end{tabular}\n";
}

}  // namespace anigen::eval
