#include "anigen/experiment/viewer.h"

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <set>
#include <system_error>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/log.h"
#include "anigen/core/table.h"
#include "anigen/core/text.h"
#include "anigen/experiment/report.h"

namespace anigen::experiment {

namespace {

namespace fs = std::filesystem;

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

bool is_file(const fs::path& file) {
  std::error_code error;
  return fs::is_regular_file(file, error);
}

/// Renames `from "./three.core.js"` and its like.
std::string with_names(std::string source, const std::vector<Module>& modules) {
  for (const Module& module : modules) {
    if (module.relative == nullptr) continue;
    for (const char quote : {'"', '\''})
      replace_all(source, quote + std::string(module.relative) + quote, quote + std::string(module.name) + quote);
  }
  return source;
}

}  // namespace

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

namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kLargestAsset = 8u << 20;
constexpr std::size_t kMostModels = 4;     // side by side
constexpr std::size_t kShownOfNames = 24;  // characters; ids are SHA-256 sums

constexpr const char kStyle[] =
    "<style>.viewer3d{margin:1em 0;padding:.6em;border:1px solid #e3e3e3;border-radius:6px;min-height:500px}"
    ".viewer3d .bar{display:flex;flex-wrap:wrap;gap:.3em 1em;align-items:center}.viewer3d select{max-width:16em}"
    ".viewer3d .labels{display:flex;margin:.3em 0}.viewer3d .labels span{flex:1;font-size:90%}"
    ".viewer3d .labels.stacked{display:block}.viewer3d .labels.stacked span{display:block}"
    ".viewer3d canvas{touch-action:none}</style>\n";

/// The part of `path` that the pattern's star stands for. @pre the path matches the pattern, which has one star
std::string starred(const std::string& pattern, const std::string& path) {
  const std::size_t star = pattern.find('*');
  return path.substr(star, path.size() + 1 - pattern.size());
}

/// Files of a viewer's entry, and their names.
struct Source {
  std::string label, pattern;
  fs::path folder;
};

std::vector<Source> sources_of(const Experiment& experiment, const Plan& plan, const ViewerSpec& spec) {
  std::vector<Source> sources;
  for (const AssetFiles& entry : spec.shown) {
    std::set<fs::path> seen;
    std::set<std::size_t> variants;
    std::vector<Source> own;
    for (const PlannedRun& run : plan.runs) {
      const auto job = run.jobs.find(entry.step);
      if (job == run.jobs.end() || !variants.insert(run.variant).second) continue;
      const fs::path& folder = plan.jobs[job->second].folder;
      if (!seen.insert(folder).second) continue;
      own.push_back({experiment.variants[run.variant].name, entry.pattern, folder});
    }
    for (Source& source : own) {
      // A file that several variants share needs no variant's name.
      source.label = own.size() == 1 ? entry.label : entry.label + ", " + source.label;
      sources.push_back(std::move(source));
    }
  }
  return sources;
}

}  // namespace

std::vector<ViewedAsset> viewed_assets(const Experiment& experiment, const Plan& plan, const ViewerSpec& spec) {
  const std::vector<Source> sources = sources_of(experiment, plan, spec);
  if (sources.empty()) return {};
  std::vector<ViewedAsset> assets;
  for (const fs::path& file : matching_files(sources.front().folder, sources.front().pattern)) {
    if (assets.size() == spec.most) break;
    ViewedAsset asset;
    asset.name = starred(sources.front().pattern, file.lexically_relative(sources.front().folder).string());
    for (const Source& source : sources) {
      const fs::path made = source.folder / file_of_asset(source.pattern, asset.name);
      std::error_code error;
      if (fs::is_regular_file(made, error)) asset.shown.push_back({source.label, made});
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
  return std::string(kStyle) + "<script type=\"importmap\">" + three_import_map(three) +
         "</script>\n<script type=\"module\">" + kViewerScript + "</script>\n";
}

}  // namespace anigen::experiment
