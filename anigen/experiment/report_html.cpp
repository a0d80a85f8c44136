#include <cstdlib>
#include <set>
#include <system_error>

#include "anigen/core/csv.h"
#include "anigen/core/error.h"
#include "anigen/core/html.h"
#include "anigen/core/log.h"
#include "anigen/eval/comparison/report_page.h"
#include "anigen/eval/line_chart.h"
#include "anigen/experiment/contact_sheet.h"
#include "anigen/experiment/report.h"
#include "anigen/experiment/report_facts.h"
#include "anigen/experiment/report_pictures.h"
#include "anigen/experiment/result_tables.h"
#include "anigen/experiment/variant_strip.h"
#include "anigen/experiment/viewer/report_viewer.h"
#include "anigen/experiment/viewer/three_modules.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;

class Page {
 public:
  Page(const Experiment& experiment, const Plan& plan, const Workplace& place, const std::vector<ResultTable>& results)
      : experiment_(experiment), plan_(plan), place_(place), results_(results) {}

  std::string html() const {
    std::string html = eval::page_begin(experiment_.title);
    if (!experiment_.purpose.empty()) html += "<p>" + html_escaped(experiment_.purpose) + "</p>\n";
    for (const ResultTable& result : results_) {
      html += "<h2>" + html_escaped(result.spec.title) + "</h2>\n<p class=\"hint\">" + spread_text(result) + "</p>\n" +
              wide(mean_table(result));
      if (!result.differences.empty())
        html += "<p class=\"hint\">" + difference_text() + "</p>\n" + wide(difference_table(result));
      if (!result.missing.empty()) html += "<p class=\"failed\">" + html_escaped(missing_text(result)) + "</p>\n";
    }
    html += viewers() + strips() + sheets() + curves() + pictures() + links();
    html += "<h2>Cost</h2>\n" + wide(cost_table(plan_, place_.out));
    html += "<h2>Where this comes from</h2>\n" + wide(provenance_table(experiment_, plan_, place_)) + commands();
    html += "<details><summary>Jobs</summary>" + wide(job_table(plan_, place_.out)) + "</details>\n";
    return html + eval::page_end();
  }

 private:
  static std::string wide(const eval::Table& table) { return "<div class=\"wide\">" + to_html(table) + "</div>\n"; }

  std::string curves() const {
    std::string html;
    for (const CurveSpec& spec : experiment_.curves) {
      std::vector<eval::Curve> lines;
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
      html += eval::curves_chart(spec.title, lines);
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
      const std::string target = fs::relative(job.folder / "report.html", place_.out).string();
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
};

}  // namespace

std::string report_html(const Experiment& experiment, const Plan& plan, const Workplace& place,
                        const std::vector<ResultTable>& results) {
  return Page(experiment, plan, place, results).html();
}

}  // namespace anigen::experiment
