#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/eval/tables.h"
#include "anigen/experiment/results.h"

namespace anigen::experiment {

/// Variant, method, assets, failures, and every column as "mean ± half of the 95 % interval"; the best of a column
/// `**bold**`, the second `_underlined_`, unless no direction is given.
eval::Table mean_table(const ResultTable& result);

/// Every variant against the first: difference, interval and p per column. Without rows when there is one variant.
eval::Table difference_table(const ResultTable& result);

/// Time, memory and disk of every step, mean over its jobs (the papers' table of cost).
eval::Table cost_table(const Plan& plan, const std::filesystem::path& out);

}  // namespace anigen::experiment
