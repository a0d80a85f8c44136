#include "anigen/experiment/sheets.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/table.h"
#include "anigen/experiment/report.h"
#include "anigen/experiment/results.h"
#include "anigen/experiment/run_jobs.h"

namespace anigen::experiment {

namespace {

namespace fs = std::filesystem;

constexpr int kHeight = 120;

std::vector<SheetCell> ranked_cells(const fs::path& file, const SheetSpec& spec) {
  const CsvTable table = read_csv(file);
  for (const std::string& needed : {std::string("id"), std::string("method"), spec.order.key}) {
    if (table.column(needed) == CsvTable::kMissing)
      throw InputError(file.string(), "line 1", "has no column '" + needed + "'");
  }
  std::vector<SheetCell> ranked, without;
  std::set<std::string> methods;
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    methods.insert(table.cell(r, "method"));
    if (table.cell(r, "method") != spec.method) continue;
    SheetCell cell;
    cell.id = table.cell(r, "id");
    cell.value = number_in(table.cell(r, spec.order.key));
    (std::isfinite(cell.value) ? ranked : without).push_back(std::move(cell));
  }
  if (methods.count(spec.method) == 0) {
    std::string known;
    for (const std::string& method : methods) known += (known.empty() ? "" : ", ") + method;
    throw InputError(file.string(), "method", "there is no '" + spec.method + "'; there are: " + known);
  }
  const bool lower = spec.order.better != Column::Better::kHigher;
  std::stable_sort(ranked.begin(), ranked.end(), [&](const SheetCell& a, const SheetCell& b) {
    return lower ? a.value < b.value : a.value > b.value;
  });
  for (std::size_t i = 0; i < ranked.size(); ++i) ranked[i].place = i + 1;
  if (!ranked.empty()) {
    ranked[ranked.size() / 2].mark = "median";
    ranked.back().mark = "worst";
    ranked.front().mark = "best";
  }
  ranked.insert(ranked.end(), without.begin(), without.end());
  return ranked;
}

/// `most` cells, evenly spaced, and beside them those with a mark.
std::vector<SheetCell> thinned(std::vector<SheetCell> cells, std::size_t most) {
  if (cells.size() <= most) return cells;
  std::vector<SheetCell> kept;
  std::size_t taken = 0;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const bool due = i * most >= taken * cells.size();
    if (!due && cells[i].mark.empty()) continue;
    taken += due ? 1 : 0;
    kept.push_back(std::move(cells[i]));
  }
  return kept;
}

std::string caption(const SheetCell& cell, const SheetSpec& spec) {
  constexpr std::size_t kShownOfId = 8;
  if (cell.place == 0) return "no value · " + html_escaped(cell.id.substr(0, kShownOfId));
  char value[40];
  std::snprintf(value, sizeof value, "%.*f", spec.order.digits, cell.value);
  return std::to_string(cell.place) + " · " + value + (cell.mark.empty() ? "" : " · <b>" + cell.mark + "</b>") + " · " +
         html_escaped(cell.id.substr(0, kShownOfId));
}

}  // namespace

std::vector<SheetCell> sheet_cells(const Plan& plan, const fs::path& out, const PlannedRun& run,
                                   const SheetSpec& spec) {
  const auto scored = run.jobs.find(spec.step);
  if (scored == run.jobs.end() || !is_done(out, plan.jobs[scored->second])) return {};
  const Job& scores = plan.jobs[scored->second];
  std::vector<SheetCell> cells = thinned(ranked_cells(scores.folder / "metrics.csv", spec), spec.most);
  for (SheetCell& cell : cells) {
    for (const AssetFiles& entry : spec.shown) {
      const auto job = run.jobs.find(entry.step);
      fs::path file;
      if (job != run.jobs.end()) file = plan.jobs[job->second].folder / file_of_asset(entry.pattern, cell.id);
      std::error_code error;
      cell.files.push_back(fs::is_regular_file(file, error) ? file : fs::path());
    }
  }
  return cells;
}

std::string sheet_html(const std::vector<SheetCell>& cells, const SheetSpec& spec) {
  std::string labels;
  for (const AssetFiles& entry : spec.shown) labels += (labels.empty() ? "" : ", ") + entry.label;
  std::string html = "<p class=\"hint\">" + html_escaped(labels) + ". Place and " + html_escaped(spec.order.label) +
                     ", from the best to the worst.</p>\n<div class=\"sheet\">\n";
  for (const SheetCell& cell : cells) {
    html += "<figure" + std::string(cell.mark.empty() ? "" : " class=\"marked\"") + "><div>";
    for (const fs::path& file : cell.files) html += thumbnail(file, kHeight);
    html += "</div><figcaption>" + caption(cell, spec) + "</figcaption></figure>\n";
  }
  return html +
         "</div>\n<style>.sheet{display:flex;flex-wrap:wrap;gap:.5em}.sheet figure{margin:0;padding:.2em;border:1px "
         "solid "
         "#e3e3e3;border-radius:4px;max-width:100%;overflow:hidden}.sheet figure.marked{border:2px solid #c60}.sheet "
         "figure>div{display:flex;overflow-x:auto}.sheet img{height:" +
         std::to_string(kHeight) + "px}.sheet figcaption{font-size:80%}.sheet .none{width:" + std::to_string(kHeight) +
         "px;color:#a00;font-size:80%}</style>\n";
}

namespace {

namespace fs = std::filesystem;

constexpr int kStripHeight = 180;

/// Text that the star of `pattern` matches in each file under `folder`.
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
