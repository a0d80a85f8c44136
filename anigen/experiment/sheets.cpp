#include "anigen/experiment/sheets.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iterator>
#include <map>
#include <set>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/log.h"
#include "anigen/core/table.h"
#include "anigen/core/text.h"
#include "anigen/experiment/results.h"
#include "anigen/experiment/run_jobs.h"
#include "anigen/io/image.h"
#include "anigen/io/image_resize.h"

namespace anigen::experiment {

namespace {

namespace fs = std::filesystem;

constexpr int kHeight = 120, kStripHeight = 180;  ///< of small pictures, pixels
constexpr std::uintmax_t kLargestPicture = 32u << 20;

bool is_file(const fs::path& file) {
  std::error_code error;
  return fs::is_regular_file(file, error);
}

bool matches(const std::string& name, const std::string& pattern) {
  const std::size_t star = pattern.find('*');
  if (star == std::string::npos) return name == pattern;
  const std::string before = pattern.substr(0, star), after = pattern.substr(star + 1);
  return name.size() >= before.size() + after.size() && name.compare(0, before.size(), before) == 0 &&
         name.compare(name.size() - after.size(), after.size(), after) == 0;
}

/// A pattern with the name of an asset in place of its star. @pre it has one
std::string file_of_asset(std::string pattern, const std::string& asset) {
  return pattern.replace(pattern.find('*'), 1, asset);
}

/// The part of `path` that the pattern's star stands for. @pre the path matches the pattern, which has one star
std::string starred(const std::string& pattern, const std::string& path) {
  const std::size_t star = pattern.find('*');
  return path.substr(star, path.size() + 1 - pattern.size());
}

std::string number_text(double value, const Column& column) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*f", column.digits, value);
  return text;
}

/// One of several equally wide pictures that a file has side by side, counted from 1.
struct Panel {
  int number = 1, of = 1;
};

io::Image panel_of(io::Image image, Panel panel) {
  if (panel.of == 1) return image;
  const int left = image.width * (panel.number - 1) / panel.of, right = image.width * panel.number / panel.of;
  io::Image part(std::max(1, right - left), image.height);
  for (int y = 0; y < part.height; ++y) {
    const std::uint8_t* row = image.pixel(std::min(left, image.width - 1), y);
    std::copy(row, row + std::ptrdiff_t{io::kImageChannels} * part.width, part.pixel(0, y));
  }
  return part;
}

/// A picture file, or a panel of it, made `height` pixels high, as an <img> of JPEG that needs no other file. What is
/// wrong with the file, or that there is none (an empty path), stands in its place.
std::string thumbnail(const fs::path& file, int height, Panel panel = {}) {
  constexpr int kQuality = 80, kWidest = 1000;
  if (file.empty()) return "<span class=\"none\">no file</span>";
  try {
    const io::Image image = panel_of(io::read_image(file), panel);
    const double width = std::round(static_cast<double>(image.width) * height / image.height);
    const io::Image small = io::resize_lanczos(image, std::clamp(static_cast<int>(width), 1, kWidest), height,
                                               io::ResizeAlpha::kPremultiplied);
    const std::vector<std::uint8_t> bytes = io::encode_jpeg(small, kQuality);
    return "<img loading=\"lazy\" alt=\"" + html_escaped(file.filename().string()) +
           "\" src=\"data:image/jpeg;base64," + base64(bytes) + "\">";
  } catch (const Error& problem) {
    return "<span class=\"none\">" + html_escaped(problem.what()) + "</span>";
  }
}

std::vector<SheetCell> ranked_cells(const fs::path& file, const SheetSpec& spec) {
  const CsvTable table = metrics_table(file, {spec.order});
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
  if (methods.count(spec.method) == 0)
    throw InputError(file.string(), "method", "there is no '" + spec.method + "'; there are: " + joined(methods));
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
  return std::to_string(cell.place) + " · " + number_text(cell.value, spec.order) +
         (cell.mark.empty() ? "" : " · <b>" + cell.mark + "</b>") + " · " + html_escaped(cell.id.substr(0, kShownOfId));
}

/// Text that the star of `pattern` matches in each file under `folder`.
std::set<std::string> assets_under(const fs::path& folder, const std::string& pattern) {
  std::set<std::string> assets;
  for (const fs::path& file : matching_files(folder, pattern))
    assets.insert(starred(pattern, fs::relative(file, folder).generic_string()));
  return assets;
}

std::map<std::string, std::string> values_of(const fs::path& file, const StripSpec& spec) {
  const CsvTable table = metrics_table(file, {spec.value});
  std::map<std::string, std::string> values;
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    const double value = number_in(table.cell(r, spec.value.key));
    if (table.cell(r, "method") != spec.value_method || !std::isfinite(value)) continue;
    values[table.cell(r, "id")] = number_text(value, spec.value);
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

constexpr std::uintmax_t kLargestModule = 8u << 20;

/// A module of the package, and what other modules call it.
struct Module {
  const char* name;      ///< in the import map
  const char* file;      ///< in the package
  const char* relative;  ///< how its siblings import it; nullptr: by its name
};

constexpr Module kAddons[] = {
    {"three/addons/GLTFLoader.js", "examples/jsm/loaders/GLTFLoader.js", nullptr},
    {"three/addons/OrbitControls.js", "examples/jsm/controls/OrbitControls.js", nullptr},
    {"three/addons/BufferGeometryUtils.js", "examples/jsm/utils/BufferGeometryUtils.js",
     "../utils/BufferGeometryUtils.js"},
};
/// Newer releases come without the small files.
constexpr Module kSmall[] = {{"three", "build/three.module.min.js", nullptr},
                             {"three/core", "build/three.core.min.js", "./three.core.min.js"}};
constexpr Module kPlain[] = {{"three", "build/three.module.js", nullptr},
                             {"three/core", "build/three.core.js", "./three.core.js"}};
/// GLTFLoader of newer releases imports it.
constexpr Module kSkeletons = {"three/addons/SkeletonUtils.js", "examples/jsm/utils/SkeletonUtils.js",
                               "../utils/SkeletonUtils.js"};

/// Renames `from "./three.core.js"` and its like.
std::string with_names(std::string source, const std::vector<Module>& modules) {
  for (const Module& module : modules) {
    if (module.relative == nullptr) continue;
    for (const char quote : {'"', '\''})
      replace_all(source, quote + std::string(module.relative) + quote, quote + std::string(module.name) + quote);
  }
  return source;
}

constexpr std::uintmax_t kLargestAsset = 8u << 20;
constexpr std::size_t kMostModels = 4;     // side by side
constexpr std::size_t kShownOfNames = 24;  // characters; ids are SHA-256 sums

constexpr const char kViewerStyle[] =
    "<style>.viewer3d{margin:1em 0;padding:.6em;border:1px solid #e3e3e3;border-radius:6px;min-height:500px}"
    ".viewer3d .bar{display:flex;flex-wrap:wrap;gap:.3em 1em;align-items:center}.viewer3d select{max-width:16em}"
    ".viewer3d .labels{display:flex;margin:.3em 0}.viewer3d .labels span{flex:1;font-size:90%}"
    ".viewer3d .labels.stacked{display:block}.viewer3d .labels.stacked span{display:block}"
    ".viewer3d canvas{touch-action:none}</style>\n";

/// Files of a viewer's entry, and their names.
struct ViewSource {
  std::string label, pattern;
  fs::path folder;
};

std::vector<ViewSource> sources_of(const Experiment& experiment, const Plan& plan, const ViewerSpec& spec) {
  std::vector<ViewSource> sources;
  for (const AssetFiles& entry : spec.shown) {
    std::set<fs::path> seen;
    std::set<std::size_t> variants;
    std::vector<ViewSource> own;
    for (const PlannedRun& run : plan.runs) {
      const auto job = run.jobs.find(entry.step);
      if (job == run.jobs.end() || !variants.insert(run.variant).second) continue;
      const fs::path& folder = plan.jobs[job->second].folder;
      if (!seen.insert(folder).second) continue;
      own.push_back({experiment.variants[run.variant].name, entry.pattern, folder});
    }
    for (ViewSource& source : own) {
      // A file that several variants share needs no variant's name.
      source.label = own.size() == 1 ? entry.label : entry.label + ", " + source.label;
      sources.push_back(std::move(source));
    }
  }
  return sources;
}

}  // namespace

std::vector<fs::path> matching_files(const fs::path& folder, const std::string& pattern) {
  std::vector<fs::path> found{folder};
  for (const fs::path& part : fs::path(pattern)) {
    std::vector<fs::path> next;
    for (const fs::path& parent : found) {
      std::error_code error;
      if (!fs::is_directory(parent, error)) continue;
      for (const auto& entry : fs::directory_iterator(parent)) {
        if (matches(entry.path().filename(), part)) next.push_back(entry.path());
      }
    }
    found = std::move(next);
  }
  std::sort(found.begin(), found.end());
  return found;
}

std::string embedded_picture(const fs::path& file) {
  const std::string extension = file.extension();
  const std::string type = extension == ".png" ? "png" : extension == ".jpg" || extension == ".jpeg" ? "jpeg" : "";
  if (type.empty()) return "";
  return "<img loading=\"lazy\" style=\"max-width:100%\" alt=\"" + html_escaped(file.filename().string()) +
         "\" src=\"data:image/" + type + ";base64," + base64(std::string_view(read_file(file, kLargestPicture))) +
         "\">";
}

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
      cell.files.push_back(is_file(file) ? file : fs::path());
    }
  }
  return cells;
}

std::string sheet_html(const std::vector<SheetCell>& cells, const SheetSpec& spec) {
  const std::string labels = joined(spec.shown, ", ", &AssetFiles::label);
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

fs::path find_three(const fs::path& start) {
  std::vector<fs::path> folders;
  for (fs::path folder = fs::absolute(start).lexically_normal();; folder = folder.parent_path()) {
    folders.push_back(folder / "node_modules");
    folders.push_back(folder / ".cache" / "node" / "node_modules");
    if (folder == folder.parent_path()) break;
  }
  if (const char* listed = std::getenv("NODE_PATH")) {
    const std::string paths = listed;
    for (std::size_t begin = 0; begin <= paths.size();) {
      const std::size_t end = std::min(paths.find(':', begin), paths.size());
      if (end > begin) folders.emplace_back(paths.substr(begin, end - begin));
      begin = end + 1;
    }
  }
  for (const fs::path& folder : folders) {
    if (is_file(folder / "three" / "package.json")) return folder / "three";
  }
  return {};
}

std::string three_import_map(const fs::path& three) {
  const bool small = is_file(three / kSmall[0].file) && is_file(three / kSmall[1].file);
  std::vector<Module> modules(std::begin(kAddons), std::end(kAddons));
  const auto& core = small ? kSmall : kPlain;
  modules.insert(modules.end(), std::begin(core), std::end(core));
  if (is_file(three / kSkeletons.file)) modules.push_back(kSkeletons);
  Json imports = Json::object();
  for (const Module& module : modules) {
    const std::string source = with_names(read_file(three / module.file, kLargestModule), modules);
    imports[module.name] = "data:text/javascript;base64," + base64(std::string_view(source));
  }
  return Json{{"imports", std::move(imports)}}.dump();
}

std::vector<ViewedAsset> viewed_assets(const Experiment& experiment, const Plan& plan, const ViewerSpec& spec) {
  const std::vector<ViewSource> sources = sources_of(experiment, plan, spec);
  if (sources.empty()) return {};
  std::vector<ViewedAsset> assets;
  for (const fs::path& file : matching_files(sources.front().folder, sources.front().pattern)) {
    if (assets.size() == spec.most) break;
    ViewedAsset asset;
    asset.name = starred(sources.front().pattern, file.lexically_relative(sources.front().folder).string());
    for (const ViewSource& source : sources) {
      const fs::path made = source.folder / file_of_asset(source.pattern, asset.name);
      if (is_file(made)) asset.shown.push_back({source.label, made});
    }
    if (asset.shown.size() > kMostModels) asset.shown.resize(kMostModels);
    assets.push_back(std::move(asset));
  }
  return assets;
}

std::string viewer_html(const std::vector<ViewedAsset>& assets, const std::string& title, std::size_t number) {
  std::string files;
  Json list = Json::array();
  for (const ViewedAsset& asset : assets) {
    Json shown = Json::array();
    for (const ViewedModel& model : asset.shown) {
      std::error_code error;
      const std::uintmax_t size = fs::file_size(model.file, error);
      if (error || size > kLargestAsset) {
        log::warn("left out of the report: {}, {} bytes", model.file.string(), error ? 0 : size);
        continue;
      }
      const std::string id =
          "glb-" + std::to_string(number) + "-" + std::to_string(list.size()) + "-" + std::to_string(shown.size());
      files += "<script type=\"text/plain\" id=\"" + id + "\">" +
               base64(std::string_view(read_file(model.file, kLargestAsset))) + "</script>\n";
      shown.push_back({{"label", model.label}, {"glb", id}});
    }
    if (!shown.empty()) list.push_back({{"name", asset.name.substr(0, kShownOfNames)}, {"shown", std::move(shown)}});
  }
  if (list.empty()) return "";
  return "<h2>" + html_escaped(title) + "</h2>\n<div class=\"viewer3d\" id=\"viewer-" + std::to_string(number) +
         "\" data-assets=\"" + html_escaped(list.dump()) + "\"></div>\n" + files;
}

std::string viewer_script_html(const fs::path& three) {
  return std::string(kViewerStyle) + "<script type=\"importmap\">" + three_import_map(three) +
         "</script>\n<script type=\"module\">" + kViewerScript + "</script>\n";
}

}  // namespace anigen::experiment
