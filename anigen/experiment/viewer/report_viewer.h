#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/experiment/plan.h"

namespace anigen::experiment {

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

/// What a viewer can show of what is done so far: one asset per file that the first of its entries finds in the first
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

}  // namespace anigen::experiment
