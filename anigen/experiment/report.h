#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/table.h"
#include "anigen/experiment/results.h"

namespace anigen::experiment {

/// Provenance of the numbers: file, seeds, version, machine, programs.
Table provenance_table(const Experiment& experiment, const Plan& plan, const Workplace& place);

/// Every job with its state, time and memory.
Table job_table(const Plan& plan, const std::filesystem::path& out);

/// "variant, seed 1"; empty when there is but one of each.
std::string run_label(const Experiment& experiment, const PlannedRun& run);

/// One sentence each on the ± of a table and on its differences.
std::string spread_text(const ResultTable& result);
std::string difference_text();

/// "Not run yet: …."; empty when nothing is missing.
std::string missing_text(const ResultTable& result);

/// Files under a folder that match a pattern whose parts may be "*" or contain one, such as "*/preview.png"; sorted.
std::vector<std::filesystem::path> matching_files(const std::filesystem::path& folder, const std::string& pattern);

/// A pattern with the name of an asset in place of its star. @pre it has one
std::string file_of_asset(std::string pattern, const std::string& asset);

/// One of several equally wide pictures that a file has side by side, counted from 1.
struct Panel {
  int number = 1, of = 1;
};

/// A picture file, or a panel of it, made `height` pixels high, as an <img> of JPEG that needs no other file. What is
/// wrong with the file, or that there is none (an empty path), stands in its place.
std::string thumbnail(const std::filesystem::path& file, int height, Panel panel = {});

/// A picture file as an <img> that needs no other file. PNG and JPEG; other endings give an empty text.
std::string embedded_picture(const std::filesystem::path& file);

/// All tables of an experiment, from what is done so far. @throws as collect_results()
std::vector<ResultTable> collect_all_results(const Experiment& experiment, const Plan& plan, const Workplace& place);

/// Writes report.html (one file that needs no other), report.md, one <n>.tex per results table, and results.json (all
/// numbers of the tables) into the experiment's folder; what is missing is named.
/// @return report.html
std::filesystem::path write_report(const Experiment& experiment, const Plan& plan, const Workplace& place);

/// The parts of it.
std::string report_html(const Experiment& experiment, const Plan& plan, const Workplace& place,
                        const std::vector<ResultTable>& results);
std::string report_markdown(const Experiment& experiment, const Plan& plan, const Workplace& place,
                            const std::vector<ResultTable>& results);
/// Only the tables of results, as they end a run on a screen.
std::string results_markdown(const std::vector<ResultTable>& results);
Json results_json(const Experiment& experiment, const std::vector<ResultTable>& results);

}  // namespace anigen::experiment
