#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/experiment/claims.h"
#include "anigen/experiment/results.h"

namespace anigen::experiment {

/// All tables of an experiment, from what is done so far. @throws as collect_results()
std::vector<ResultTable> collect_all_results(const Experiment& experiment, const Plan& plan, const Workplace& place);

/// Writes report.html (one file that needs no other), report.md, one <n>.tex per results table, and results.json (all
/// numbers of the tables and claims) into the experiment's folder; what is missing is named.
/// @return report.html
std::filesystem::path write_report(const Experiment& experiment, const Plan& plan, const Workplace& place);

/// Its page.
std::string report_html(const Experiment& experiment, const Plan& plan, const Workplace& place,
                        const std::vector<ResultTable>& results, const std::vector<ClaimResult>& claims);
/// Only claims and tables of results, as they end a run on a screen.
std::string results_markdown(const std::vector<ResultTable>& results, const std::vector<ClaimResult>& claims);

/// An experiment of a collection.
struct CollectedClaims {
  std::string title, failure;  ///< failure empty: it ran
  double seconds = 0;          ///< of all its jobs
  std::vector<ClaimResult> claims;
};

/// Writes verdicts.md, verdicts.html and verdicts.json: the claims of all experiments, with counts of verdicts.
/// @param scale that they ran at; empty: as their files have it @return the text of verdicts.md
std::string write_verdicts(const Collection& collection, const std::vector<CollectedClaims>& experiments,
                           const std::string& scale, const std::filesystem::path& out);

}  // namespace anigen::experiment
