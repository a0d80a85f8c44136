#include "anigen/eval/comparison/comparison_files.h"

namespace anigen::eval {
namespace {

void add_section(std::string& text, const std::string& title, const Table& table) {
  if (!table.rows.empty()) text += "\n## " + title + "\n\n" + to_markdown(table);
}

}  // namespace

std::string transport_text(const Comparison& comparison) {
  const Json solver = comparison.settings.value("transport", Json::object());
  if (solver.value("solver", "exact") == "exact") return "";
  return "W and GW by Sinkhorn iterations; epsilon " + solver.at("epsilon_wasserstein").dump() + " and " +
         solver.at("epsilon_gromov_wasserstein").dump() + " of the largest squared distance.";
}

std::string to_markdown(const Comparison& comparison) {
  std::string text = "# " + std::to_string(comparison.ids.size()) + " ground truths\n\n" +
                     to_markdown(method_table(comparison, present_metrics(comparison, true)));
  if (comparison.methods.size() > 1)
    text += "\nBest in bold, second best in italics; methods with values on different assets are not ranked.\n";
  const std::string transport = transport_text(comparison);
  if (!transport.empty()) text += "\n" + transport + "\n";
  add_section(text, "Pairs", pairing_table(comparison));
  add_section(text, "Differences to " + comparison.methods[0], difference_table(comparison));
  for (std::size_t m = 0; m < comparison.methods.size(); ++m)
    add_section(text, "All metrics, " + comparison.methods[m], metric_summary_table(comparison, m));
  add_section(text, "Not computed", reason_table(comparison));
  return text;
}

std::string to_latex(const Comparison& comparison) {
  Table table = method_table(comparison, present_metrics(comparison, true));
  // Papers say elsewhere how many assets there were.
  const auto shorten = [](std::vector<std::string>& cells) { cells.erase(cells.begin() + 1, cells.begin() + 3); };
  shorten(table.columns);
  for (auto& row : table.rows) shorten(row);
  const std::string transport = transport_text(comparison);
  return (transport.empty() ? "" : "% " + transport + "\n") + to_latex(table);
}

}  // namespace anigen::eval
