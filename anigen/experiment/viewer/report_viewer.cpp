#include "anigen/experiment/viewer/report_viewer.h"

#include <set>
#include <system_error>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/base64.h"
#include "anigen/core/html.h"
#include "anigen/core/json.h"
#include "anigen/core/log.h"
#include "anigen/experiment/report_pictures.h"
#include "anigen/experiment/viewer/three_modules.h"
#include "anigen/experiment/viewer/viewer_script.h"

namespace anigen::experiment {
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

/// Where a viewer's entry finds its files, and how each is called.
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
      // What several variants share needs no variant's name.
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
