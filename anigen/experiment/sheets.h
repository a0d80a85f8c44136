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

}  // namespace anigen::experiment
