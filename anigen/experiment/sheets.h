#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/experiment/plan.h"

namespace anigen::experiment {

/// An asset of a sheet and where it stands among all.
struct SheetCell {
  std::string id;
  std::size_t place = 0;  ///< from 1, the best; 0: it has no value
  double value = 0;
  std::string mark;                          ///< "best", "median", "worst", or empty
  std::vector<std::filesystem::path> files;  ///< one per entry of the sheet; an empty path where there is no file
};

/// Every asset that the sheet's method has a row for, from the best to the worst, those without a value last. Of more
/// than spec.most as many are taken, evenly spaced, and beside them best, median and worst.
/// @return empty while the evaluation of that run is not done, or not planned
/// @throws InputError for a file of metrics without "id", "method" or the wanted column, or without that method
std::vector<SheetCell> sheet_cells(const Plan& plan, const std::filesystem::path& out, const PlannedRun& run,
                                   const SheetSpec& spec);

/// The cells with their pictures as small JPEG files, and what the mark and the value are.
std::string sheet_html(const std::vector<SheetCell>& cells, const SheetSpec& spec);

/// Result of one variant for an asset.
struct StripCell {
  std::filesystem::path file;  ///< empty where the variant has none
  std::string value;           ///< of the wanted column, as shown; empty where there is none
};

/// One asset: what every variant made of it.
struct StripRow {
  std::string asset;
  std::vector<StripCell> cells;  ///< one per column of the strip
};

/// Assets under every variant, side by side, as the paper shows joint densities: a row per asset, a column per
/// variant, of the first seed.
struct Strip {
  std::vector<std::string> columns;
  std::vector<StripRow> rows;  ///< sorted by the assets' names, spec.most of them, evenly spaced
};

/// @throws InputError for a file of metrics without "id", "method" or the wanted column
Strip variant_strip(const Experiment& experiment, const Plan& plan, const std::filesystem::path& out,
                    const StripSpec& spec);

std::string strip_html(const Strip& strip, const StripSpec& spec);

/// Files under a folder that match a pattern whose parts may be "*" or contain one, such as "*/preview.png"; sorted.
std::vector<std::filesystem::path> matching_files(const std::filesystem::path& folder, const std::string& pattern);

/// A picture file as an <img> that needs no other file. PNG and JPEG; other endings give an empty text.
std::string embedded_picture(const std::filesystem::path& file);

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
