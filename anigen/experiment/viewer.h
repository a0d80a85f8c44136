#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/experiment/plan.h"

namespace anigen::experiment {

/// The folder of the npm package "three", looked for as Node does: node_modules of `start` and of the folders above it,
/// then the folders of NODE_PATH; and beside each node_modules in .cache/node, where scripts/setup.sh puts it.
/// @return empty when there is none
std::filesystem::path find_three(const std::filesystem::path& start);

/// An import map, {"imports": …}, that holds three.js itself with what viewer.mjs needs, so that a page needs neither
/// files nor a network: every module is a data: URL, and imports between them are renamed.
/// @param three as find_three() gives it @throws InputError naming the file that is missing
std::string three_import_map(const std::filesystem::path& three);

/// A GLB of a 3D view and what is written below it.
struct ViewedModel {
  std::string label;
  std::filesystem::path file;
};

/// An asset, as several makers see it.
struct ViewedAsset {
  std::string name;
  std::vector<ViewedModel> shown;
};

/// Entries that a viewer can show so far: one asset per file that the first of its entries finds in the first
/// variant, named by what stands where the pattern has its star; then the files of that name of every other variant
/// and of the other entries. Of several seeds the first.
std::vector<ViewedAsset> viewed_assets(const Experiment& experiment, const Plan& plan, const ViewerSpec& spec);

/// Views with their assets in them as HTML; needs kViewerScript and three_import_map() in the same page. Files above
/// 8 MiB are left out, with a warning.
/// @param number of this view, for ids that differ within the page
/// @return empty when there is nothing to see
std::string viewer_html(const std::vector<ViewedAsset>& assets, const std::string& title, std::size_t number);

/// Style, import map and script; once per page, behind the views. @throws as three_import_map()
std::string viewer_script_html(const std::filesystem::path& three);

/// viewer.mjs, the module that shows assets in a report.
extern const char* const kViewerScript;

}  // namespace anigen::experiment
