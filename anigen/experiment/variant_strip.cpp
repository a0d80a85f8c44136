#include "anigen/experiment/variant_strip.h"

#include <cmath>
#include <cstdio>
#include <map>
#include <set>
#include <system_error>

#include "anigen/core/csv.h"
#include "anigen/core/error.h"
#include "anigen/core/html.h"
#include "anigen/experiment/job_record.h"
#include "anigen/experiment/report_pictures.h"
#include "anigen/experiment/results.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;

constexpr int kStripHeight = 180;

/// What the star of `pattern` stands for in each file under `folder`.
std::set<std::string> assets_under(const fs::path& folder, const std::string& pattern) {
  const std::size_t before = pattern.find('*'), after = pattern.size() - before - 1;
  std::set<std::string> assets;
  for (const fs::path& file : matching_files(folder, pattern)) {
    const std::string name = fs::relative(file, folder).generic_string();
    assets.insert(name.substr(before, name.size() - before - after));
  }
  return assets;
}

std::map<std::string, std::string> values_of(const fs::path& file, const StripSpec& spec) {
  const CsvTable table = read_csv(file);
  for (const std::string& needed : {std::string("id"), std::string("method"), spec.value.key}) {
    if (table.column(needed) == CsvTable::kMissing)
      throw InputError(file.string(), "line 1", "has no column '" + needed + "'");
  }
  std::map<std::string, std::string> values;
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    const double value = number_in(table.cell(r, spec.value.key));
    if (table.cell(r, "method") != spec.value_method || !std::isfinite(value)) continue;
    char text[40];
    std::snprintf(text, sizeof text, "%.*f", spec.value.digits, value);
    values[table.cell(r, "id")] = text;
  }
  return values;
}

std::vector<std::string> evenly(const std::set<std::string>& all, std::size_t most) {
  std::vector<std::string> kept;
  std::size_t i = 0;
  for (const std::string& one : all) {
    if (i++ * most >= kept.size() * all.size() && kept.size() < most) kept.push_back(one);
  }
  return kept;
}

}  // namespace

Strip variant_strip(const Experiment& experiment, const Plan& plan, const fs::path& out, const StripSpec& spec) {
  struct Source {
    fs::path folder;
    std::set<std::string> assets;
    std::map<std::string, std::string> values;
  };
  Strip strip;
  std::vector<Source> sources;
  std::set<std::string> all;
  for (const PlannedRun& run : plan.runs) {
    const auto made = run.jobs.find(spec.step);
    if (run.seed != experiment.seeds.front() || made == run.jobs.end() || !is_done(out, plan.jobs[made->second]))
      continue;
    Source source;
    source.folder = plan.jobs[made->second].folder;
    source.assets = assets_under(source.folder, spec.pattern);
    all.insert(source.assets.begin(), source.assets.end());
    const auto scored = run.jobs.find(spec.value_step);
    if (scored != run.jobs.end() && is_done(out, plan.jobs[scored->second]))
      source.values = values_of(plan.jobs[scored->second].folder / "metrics.csv", spec);
    strip.columns.push_back(experiment.variants[run.variant].name);
    sources.push_back(std::move(source));
  }
  for (const std::string& asset : evenly(all, spec.most)) {
    StripRow row{asset, {}};
    for (const Source& source : sources) {
      StripCell cell;
      if (source.assets.count(asset) > 0) cell.file = source.folder / file_of_asset(spec.pattern, asset);
      const auto value = source.values.find(asset);
      if (value != source.values.end()) cell.value = value->second;
      row.cells.push_back(std::move(cell));
    }
    strip.rows.push_back(std::move(row));
  }
  return strip;
}

std::string strip_html(const Strip& strip, const StripSpec& spec) {
  std::string html = "<div class=\"wide\"><table class=\"strip\"><tr>";
  if (spec.first_panel > 0) html += "<th></th>";
  for (const std::string& column : strip.columns) html += "<th>" + html_escaped(column) + "</th>";
  html += "</tr>\n";
  for (const StripRow& row : strip.rows) {
    html += "<tr>";
    if (spec.first_panel > 0) {
      fs::path any;
      for (const StripCell& cell : row.cells) any = any.empty() ? cell.file : any;
      html += "<td>" + thumbnail(any, kStripHeight, {spec.first_panel, spec.panels}) + "</td>";
    }
    for (const StripCell& cell : row.cells) {
      html += "<td>" + thumbnail(cell.file, kStripHeight, {spec.panel, spec.panels});
      if (!cell.value.empty()) html += "<br>" + html_escaped(spec.value.label + " " + cell.value);
      html += "</td>";
    }
    html += "</tr>\n";
  }
  return html +
         "</table></div>\n<style>.strip td{text-align:center;font-size:80%;padding:.2em}.strip .none{color:#a00}" +
         "</style>\n";
}

}  // namespace anigen::experiment
