#include "anigen/experiment/report.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <map>
#include <set>
#include <system_error>
#include <thread>

#include "anigen/core/chart.h"
#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/table.h"
#include "anigen/core/text.h"
#include "anigen/core/version.h"
#include "anigen/eval/comparison_report.h"
#include "anigen/eval/skin_evaluation.h"
#include "anigen/experiment/command.h"
#include "anigen/experiment/method_costs.h"
#include "anigen/experiment/run_jobs.h"
#include "anigen/experiment/sheets.h"

namespace anigen::experiment {

namespace {

namespace fs = std::filesystem;

std::string processor() {
  std::ifstream stream("/proc/cpuinfo");
  for (std::string line; std::getline(stream, line);) {
    const std::size_t colon = line.find(": ");
    if (line.rfind("model name", 0) == 0 && colon != std::string::npos) return line.substr(colon + 2);
  }
  return "unknown processor";
}

/// Provenance of the numbers: file, seeds, version, machine, programs.
Table provenance_table(const Experiment& experiment, const Plan& plan, const Workplace& place) {
  std::size_t done = 0, of_other_code = 0;
  std::set<std::string> programs;
  for (const Job& job : plan.jobs) {
    done += is_done(place.out, job) ? 1 : 0;
    of_other_code += job.of_other_code ? 1 : 0;
    programs.insert(job.program);
  }
  Table table{{"what", "is"}, {}};
  table.rows = {{"experiment", experiment.file.string()},
                {"written", utc_now()},
                {"jobs done", std::to_string(done) + " of " + std::to_string(plan.jobs.size()) +
                                  (of_other_code > 0 ? ", " + std::to_string(of_other_code) + " by other code" : "")},
                {"scale", experiment.scale.empty() ? "as the file has it" : experiment.scale},
                {"seeds", joined(experiment.seeds) + (experiment.seeded.empty() ? " (no step takes them)" : "")},
                {"made by", "AniGen " + named_version() + ", " + kCompiler +
                                (kTorchVersion[0] != '\0' ? std::string(", LibTorch ") + kTorchVersion : "")},
                {"machine", processor() + ", " + std::to_string(std::thread::hardware_concurrency()) + " threads"},
                {"device", place.device}};
  constexpr std::size_t kDigits = 16;
  for (const std::string& program : programs)
    table.rows.push_back({program, "SHA-256 " + program_fingerprint(place.programs / program).substr(0, kDigits)});
  return table;
}

/// Every job with its state, time and memory.
Table job_table(const Plan& plan, const fs::path& out) {
  Table table{{"job", "for", "state", "time", "peak memory", "attempts"}, {}};
  for (const Job& job : plan.jobs) {
    const auto record = read_record(out, job.id);
    const std::string whom = job.serves.size() > 1 ? std::to_string(job.serves.size()) + " runs" : job.serves.front();
    if (!record) {
      table.rows.push_back({job.id, whom, "not begun", "", "", ""});
    } else {
      const std::string state = std::string(word_of(record->state)) + (job.of_other_code ? ", by other code" : "");
      table.rows.push_back({job.id, whom, state, duration_text(record->seconds),
                            size_text(static_cast<double>(record->peak_bytes)), std::to_string(record->attempts)});
    }
  }
  return table;
}

/// One sentence on the ± of a table.
std::string spread_text(const ResultTable& result) {
  std::size_t seeds = 0;
  for (const Row& row : result.rows)
    for (const Cell& cell : row.cells) seeds = std::max(seeds, cell.by_seed.size());
  if (seeds < 2) return "Mean over assets ± half of its 95 % interval (bootstrap over assets).";
  return "Mean over seeds ± half of its 95 % interval (Student's t over up to " + std::to_string(seeds) +
         " seeds; over assets by bootstrap where no seed changes anything).";
}

std::string difference_text() {
  return "Against the first variant, asset by asset, each asset's value being its mean over the seeds in which both "
         "have one: "
         "mean, 95 % bootstrap interval over assets, p by exchanging signs at random (from 6 assets on).";
}

/// "Not run yet: …."; empty when nothing is missing.
std::string missing_text(const ResultTable& result) {
  return result.missing.empty() ? "" : "Not run yet: " + joined(result.missing) + ".";
}

constexpr const char* kCostText =
    "Wall time of a method's call, start-up included, divided by its assets; the largest resident set; parameters of "
    "the "
    "models that it loads; training of these alone, without what they begin from.";

class Page {
 public:
  Page(const Experiment& experiment, const Plan& plan, const Workplace& place, const std::vector<ResultTable>& results,
       const std::vector<ClaimResult>& claims)
      : experiment_(experiment), plan_(plan), place_(place), results_(results), claims_(claims) {}

  std::string html() const {
    std::string html = eval::page_begin(experiment_.title);
    if (!experiment_.purpose.empty()) html += "<p>" + html_escaped(experiment_.purpose) + "</p>\n";
    if (!claims_.empty())
      html +=
          "<h2>Claims</h2>\n<p class=\"hint\">" + html_escaped(claim_text()) + "</p>\n" + wide(claim_table(claims_));
    for (const ResultTable& result : results_) {
      html += "<h2>" + html_escaped(result.spec.title) + "</h2>\n<p class=\"hint\">" + spread_text(result) + "</p>\n" +
              wide(mean_table(result));
      if (!result.differences.empty())
        html += "<p class=\"hint\">" + difference_text() + "</p>\n" + wide(difference_table(result));
      if (!result.missing.empty()) html += "<p class=\"failed\">" + html_escaped(missing_text(result)) + "</p>\n";
    }
    html += viewers() + strips() + sheets() + curves() + pictures() + links();
    for (const CostSpec& spec : experiment_.costs) {
      html += "<h2>" + html_escaped(spec.title) + "</h2>\n<p class=\"hint\">" + kCostText + "</p>\n" +
              wide(method_cost_table(method_costs(plan_, place_.out, spec)));
    }
    html += "<h2>Cost</h2>\n" + wide(cost_table(plan_, place_.out));
    html += "<h2>Where this comes from</h2>\n" + wide(provenance_table(experiment_, plan_, place_)) + commands();
    html += "<details><summary>Jobs</summary>" + wide(job_table(plan_, place_.out)) + "</details>\n";
    return html + eval::page_end();
  }

 private:
  static std::string wide(const Table& table) { return "<div class=\"wide\">" + to_html(table) + "</div>\n"; }

  std::string curves() const {
    std::string html;
    for (const CurveSpec& spec : experiment_.curves) {
      std::vector<Curve> lines;
      std::set<std::size_t> seen;
      for (const PlannedRun& run : plan_.runs) {
        const std::size_t j = run.jobs.at(spec.step);
        const fs::path file = plan_.jobs[j].folder / "metrics.csv";
        std::error_code error;
        if (!seen.insert(j).second || !fs::exists(file, error)) continue;
        try {
          lines.push_back({run_label(experiment_, run), points(read_csv(file), spec.column)});
        } catch (const InputError& problem) {  // of a training that is being written, or was killed
          log::warn("left out of the report: {}", problem.what());
        }
      }
      html += curves_chart(spec.title, lines);
    }
    return html.empty() ? "" : "<h2>Training</h2>\n<div>" + html + "</div>\n";
  }

  static std::vector<std::pair<double, double>> points(const CsvTable& table, const std::string& column) {
    std::vector<std::pair<double, double>> points;
    for (std::size_t r = 0; r < table.rows.size(); ++r) {
      const std::string &x = table.cell(r, "step"), &y = table.cell(r, column);
      if (!x.empty() && !y.empty())
        points.emplace_back(std::strtod(x.c_str(), nullptr), std::strtod(y.c_str(), nullptr));
    }
    return points;
  }

  std::string pictures() const {
    std::string html;
    for (const PictureSpec& spec : experiment_.pictures) {
      std::string figures;
      std::set<std::size_t> variants;
      for (const PlannedRun& run : plan_.runs) {
        if (!variants.insert(run.variant).second) continue;
        const std::vector<fs::path> files = matching_files(plan_.jobs[run.jobs.at(spec.step)].folder, spec.files);
        for (std::size_t f = 0; f < files.size() && f < spec.most; ++f) {
          const fs::path shown = fs::relative(files[f], plan_.jobs[run.jobs.at(spec.step)].folder);
          figures += "<figure><figcaption>" + html_escaped(run_label(experiment_, run)) + " " +
                     html_escaped(shown.string()) + "</figcaption>" + picture_or_reason(files[f]) + "</figure>\n";
        }
      }
      if (!figures.empty()) html += "<h2>" + html_escaped(spec.title) + "</h2>\n" + figures;
    }
    return html;
  }

  std::string sheets() const {
    std::string html;
    for (const SheetSpec& spec : experiment_.sheets) {
      std::set<std::size_t> jobs;
      for (const PlannedRun& run : plan_.runs) {
        const auto scored = run.jobs.find(spec.step);
        if (run.seed != experiment_.seeds.front() || scored == run.jobs.end() || !jobs.insert(scored->second).second)
          continue;
        const std::string label = run_label(experiment_, run);
        try {
          const std::vector<SheetCell> cells = sheet_cells(plan_, place_.out, run, spec);
          if (cells.empty()) continue;
          html += "<h2>" + html_escaped(spec.title + (label.empty() ? "" : ": " + label)) + "</h2>\n" +
                  sheet_html(cells, spec);
        } catch (const InputError& problem) {
          html += "<p class=\"failed\">No sheet: " + html_escaped(problem.what()) + "</p>\n";
        }
      }
    }
    return html;
  }

  std::string strips() const {
    std::string html;
    for (const StripSpec& spec : experiment_.strips) {
      try {
        const Strip strip = variant_strip(experiment_, plan_, place_.out, spec);
        if (!strip.rows.empty()) html += "<h2>" + html_escaped(spec.title) + "</h2>\n" + strip_html(strip, spec);
      } catch (const InputError& problem) {
        html += "<p class=\"failed\">No strip: " + html_escaped(problem.what()) + "</p>\n";
      }
    }
    return html;
  }

  std::string viewers() const {
    std::string html;
    std::size_t number = 0;
    for (const ViewerSpec& spec : experiment_.viewers)
      html += viewer_html(viewed_assets(experiment_, plan_, spec), spec.title, ++number);
    if (html.empty()) return "";
    const fs::path three = find_three(experiment_.file.parent_path());
    if (three.empty()) {
      log::warn("the report has no 3D views: three.js is not installed (scripts/setup.sh does it)");
      return "<p class=\"hint\">No 3D views: three.js was not installed where this report was written.</p>\n";
    }
    try {
      return html + viewer_script_html(three);
    } catch (const Error& problem) {
      return "<p class=\"failed\">No 3D views: " + html_escaped(problem.what()) + "</p>\n";
    }
  }

  static std::string picture_or_reason(const fs::path& file) {
    try {
      return embedded_picture(file);
    } catch (const Error& problem) {
      return "<p class=\"failed\">No picture: " + html_escaped(problem.what()) + "</p>";
    }
  }

  /// Reports that steps wrote themselves.
  std::string links() const {
    std::string html;
    for (const Job& job : plan_.jobs) {
      std::error_code error;
      if (job.writes_into_other || !fs::exists(job.folder / "report.html", error)) continue;
      const std::string target = fs::relative(job.folder / "report.html", place_.report_folder()).string();
      html += "<li><a href=\"" + html_escaped(target) + "\">" + html_escaped(job.id) + "</a> " +
              html_escaped(job.serves.front()) + "</li>\n";
    }
    return html.empty() ? "" : "<h2>Reports of single steps</h2>\n<ul>" + html + "</ul>\n";
  }

  std::string commands() const {
    std::string html = "<details><summary>Commands</summary><pre>";
    for (const Job& job : plan_.jobs) html += html_escaped(shell_line(job.command)) + "\n";
    html += "</pre></details>\n<details><summary>Variants</summary><pre>";
    for (const Variant& variant : experiment_.variants)
      html += html_escaped(variant.name + " " + variant.changes.dump(2)) + "\n";
    return html + "</pre></details>\n";
  }

  const Experiment& experiment_;
  const Plan& plan_;
  const Workplace& place_;
  const std::vector<ResultTable>& results_;
  const std::vector<ClaimResult>& claims_;
};

Json differences_of(const ResultTable& result) {
  Json all = Json::array();
  for (const Difference& difference : result.differences) {
    Json values = Json::object();
    for (std::size_t c = 0; c < difference.columns.size(); ++c) {
      const eval::PairedDifference& of = difference.columns[c];
      const double p = difference.p[c];
      values[result.spec.columns[c].key] = {{"mean", of.mean},
                                            {"low", of.interval.low},
                                            {"high", of.interval.high},
                                            {"n", of.n},
                                            {"p", std::isfinite(p) ? Json(p) : Json(nullptr)}};
    }
    all.push_back({{"variant", result.rows[difference.row].variant},
                   {"against", result.rows[difference.against].variant},
                   {"method", result.rows[difference.row].method},
                   {"values", values}});
  }
  return all;
}

Json results_json(const Experiment& experiment, const std::vector<ResultTable>& results,
                  const std::vector<ClaimResult>& claims, const Json& costs) {
  Json tables = Json::array();
  for (const ResultTable& result : results) {
    Json rows = Json::array();
    for (const Row& row : result.rows) {
      Json cells = Json::object();
      for (std::size_t c = 0; c < row.cells.size(); ++c) {
        const Cell& cell = row.cells[c];
        if (!cell.has()) continue;
        cells[result.spec.columns[c].key] = {
            {"mean", cell.mean}, {"low", cell.interval.low}, {"high", cell.interval.high}, {"by_seed", cell.by_seed}};
      }
      rows.push_back({{"variant", row.variant},
                      {"method", row.method},
                      {"assets", row.assets},
                      {"failed", row.failed},
                      {"values", cells}});
    }
    tables.push_back({{"title", result.spec.title},
                      {"rows", rows},
                      {"differences", differences_of(result)},
                      {"missing", result.missing}});
  }
  return {{"title", experiment.title},
          {"seeds", experiment.seeds},
          {"tables", tables},
          {"claims", claims_json(claims)},
          {"costs", costs}};
}

}  // namespace

std::string report_html(const Experiment& experiment, const Plan& plan, const Workplace& place,
                        const std::vector<ResultTable>& results, const std::vector<ClaimResult>& claims) {
  return Page(experiment, plan, place, results, claims).html();
}

std::vector<ResultTable> collect_all_results(const Experiment& experiment, const Plan& plan, const Workplace& place) {
  std::vector<ResultTable> results;
  for (const TableSpec& spec : experiment.tables) results.push_back(collect_results(experiment, plan, place.out, spec));
  return results;
}

std::string results_markdown(const std::vector<ResultTable>& results, const std::vector<ClaimResult>& claims) {
  std::string text;
  if (!claims.empty()) text += "\n## Claims\n\n" + claim_text() + "\n\n" + to_markdown(claim_table(claims));
  for (const ResultTable& result : results) {
    text += "\n## " + result.spec.title + "\n\n" + spread_text(result) + "\n\n" + to_markdown(mean_table(result));
    if (!result.differences.empty()) text += "\n" + difference_text() + "\n\n" + to_markdown(difference_table(result));
    if (!result.missing.empty()) text += "\n" + missing_text(result) + "\n";
  }
  return text;
}

fs::path write_report(const Experiment& experiment, const Plan& plan, const Workplace& place) {
  const fs::path folder = place.report_folder();
  make_folders(folder);
  const std::vector<ResultTable> results = collect_all_results(experiment, plan, place);
  const std::vector<ClaimResult> claims = judge_claims(experiment, plan, place.out);
  std::string text = "# " + experiment.title + "\n\n";
  if (!experiment.purpose.empty()) text += experiment.purpose + "\n\n";
  text += to_markdown(provenance_table(experiment, plan, place)) + results_markdown(results, claims);
  Json costs = Json::array();
  for (const CostSpec& spec : experiment.costs) {
    const std::vector<MethodCost> found = method_costs(plan, place.out, spec);
    text += "\n## " + spec.title + "\n\n" + kCostText + "\n\n" + to_markdown(method_cost_table(found));
    costs.push_back({{"title", spec.title}, {"rows", to_json(found)}});
  }
  text += "\n## Cost\n\n" + to_markdown(cost_table(plan, place.out)) + "\n## Jobs\n\n" +
          to_markdown(job_table(plan, place.out));
  write_file_atomically(folder / "report.md", text);
  for (std::size_t t = 0; t < results.size(); ++t)
    write_file_atomically(folder / (std::to_string(t + 1) + ".tex"), to_latex(mean_table(results[t])));
  write_config(folder / "results.json", results_json(experiment, results, claims, costs));
  const fs::path page = folder / "report.html";
  write_file_atomically(page, report_html(experiment, plan, place, results, claims));
  return page;
}

std::string write_verdicts(const Collection& collection, const std::vector<CollectedClaims>& experiments,
                           const std::string& scale, const fs::path& out) {
  std::map<std::string, std::size_t> counts;
  Table costs{{"experiment", "claims", "time of its jobs", "state"}, {}};
  Json json = Json::array();
  std::string tables, pages;
  for (const CollectedClaims& one : experiments) {
    for (const ClaimResult& claim : one.claims) ++counts[word_of(claim.verdict)];
    costs.rows.push_back({one.title, std::to_string(one.claims.size()), duration_text(one.seconds),
                          one.failure.empty() ? "done" : one.failure});
    json.push_back({{"title", one.title}, {"seconds", one.seconds}, {"claims", claims_json(one.claims)}});
    if (!one.failure.empty()) json.back()["failure"] = one.failure;
    if (one.claims.empty()) continue;
    tables += "\n## " + one.title + "\n\n" + to_markdown(claim_table(one.claims));
    pages += "<h2>" + html_escaped(one.title) + "</h2>\n<div class=\"wide\">" + to_html(claim_table(one.claims)) +
             "</div>\n";
  }
  std::string sum;
  for (const auto& [word, count] : counts) sum += (sum.empty() ? "" : ", ") + std::to_string(count) + " " + word;
  sum = (scale.empty() ? "" : "At the scale " + scale + ": ") + (sum.empty() ? "no claims." : sum + ".");
  const std::string text = "# " + collection.title + "\n\n" + collection.purpose + "\n\n" + sum + " " + claim_text() +
                           "\n" + tables + "\n## Cost\n\n" + to_markdown(costs);
  write_file_atomically(out / "verdicts.md", text);
  write_file_atomically(out / "verdicts.html",
                        eval::page_begin(collection.title) + "<p>" + html_escaped(collection.purpose + " " + sum) +
                            "</p>\n<p class=\"hint\">" + html_escaped(claim_text()) + "</p>\n" + pages +
                            "<h2>Cost</h2>\n<div class=\"wide\">" + to_html(costs) + "</div>\n" + eval::page_end());
  write_config(out / "verdicts.json", {{"title", collection.title}, {"scale", scale}, {"experiments", json}});
  return text;
}

}  // namespace anigen::experiment
