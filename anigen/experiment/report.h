#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/experiment/results.h"

namespace anigen::experiment {

/// All tables of an experiment, from what is done so far. @throws as collect_results()
std::vector<ResultTable> collect_all_results(const Experiment& experiment, const Plan& plan, const Workplace& place);

/// Writes report.html (one file that needs no other), report.md, one <n>.tex per results table, and results.json (all
/// numbers of the tables) into the experiment's folder; what is missing is named.
/// @return report.html
std::filesystem::path write_report(const Experiment& experiment, const Plan& plan, const Workplace& place);

/// Its page.
std::string report_html(const Experiment& experiment, const Plan& plan, const Workplace& place,
                        const std::vector<ResultTable>& results);
/// Only the tables of results, as they end a run on a screen.
std::string results_markdown(const std::vector<ResultTable>& results);

}  // namespace anigen::experiment
