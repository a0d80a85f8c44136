#include "anigen/experiment/report.h"

#include "anigen/core/atomic_file.h"
#include "anigen/core/config_file.h"
#include "anigen/experiment/report_facts.h"
#include "anigen/experiment/result_tables.h"

namespace anigen::experiment {

namespace fs = std::filesystem;

std::vector<ResultTable> collect_all_results(const Experiment& experiment, const Plan& plan, const Workplace& place) {
  std::vector<ResultTable> results;
  for (const TableSpec& spec : experiment.tables) results.push_back(collect_results(experiment, plan, place.out, spec));
  return results;
}

std::string results_markdown(const std::vector<ResultTable>& results) {
  std::string text;
  for (const ResultTable& result : results) {
    text += "\n## " + result.spec.title + "\n\n" + spread_text(result) + "\n\n" + to_markdown(mean_table(result));
    if (!result.differences.empty()) text += "\n" + difference_text() + "\n\n" + to_markdown(difference_table(result));
    if (!result.missing.empty()) text += "\n" + missing_text(result) + "\n";
  }
  return text;
}

std::string report_markdown(const Experiment& experiment, const Plan& plan, const Workplace& place,
                            const std::vector<ResultTable>& results) {
  std::string text = "# " + experiment.title + "\n\n";
  if (!experiment.purpose.empty()) text += experiment.purpose + "\n\n";
  text += to_markdown(provenance_table(experiment, plan, place)) + results_markdown(results);
  return text + "\n## Cost\n\n" + to_markdown(cost_table(plan, place.out)) + "\n## Jobs\n\n" +
         to_markdown(job_table(plan, place.out));
}

fs::path write_report(const Experiment& experiment, const Plan& plan, const Workplace& place) {
  const std::vector<ResultTable> results = collect_all_results(experiment, plan, place);
  write_file_atomically(place.out / "report.md", report_markdown(experiment, plan, place, results));
  for (std::size_t t = 0; t < results.size(); ++t)
    write_file_atomically(place.out / (std::to_string(t + 1) + ".tex"), eval::to_latex(mean_table(results[t])));
  write_config(place.out / "results.json", results_json(experiment, results));
  const fs::path page = place.out / "report.html";
  write_file_atomically(page, report_html(experiment, plan, place, results));
  return page;
}

}  // namespace anigen::experiment
