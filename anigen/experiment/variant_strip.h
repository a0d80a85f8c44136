#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/experiment/plan.h"

namespace anigen::experiment {

/// What one variant made of an asset.
struct StripCell {
  std::filesystem::path file;  ///< empty where the variant has none
  std::string value;           ///< of the wanted column, as shown; empty where there is none
};

/// One asset: what every variant made of it.
struct StripRow {
  std::string asset;
  std::vector<StripCell> cells;  ///< one per column of the strip
};

/// The same assets under every variant, side by side, as the paper shows joint densities: a row per asset, a column per
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
