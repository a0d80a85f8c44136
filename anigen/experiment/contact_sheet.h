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

}  // namespace anigen::experiment
