#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "anigen/core/table.h"
#include "anigen/eval/comparison.h"
#include "anigen/eval/metric_table.h"

namespace anigen::eval {

/// True unless a metric was measured in different ways on some asset that both methods have: registered by other
/// features (a prediction without a mesh by its joints), or its motion compared by other points. Such values do not
/// compare.
bool measured_alike(const Comparison& comparison, std::size_t first, std::size_t second, const std::string& key);

/// Rank of every method by mean: 1 for the best, 2 for the second; 0 for the others, and where nothing can be ranked
/// (one method, no direction, different assets have values, or not all were measured_alike()).
std::vector<int> ranks(const Comparison& comparison, const MetricInfo& metric);

/// Difference of a method to the first one on the assets that both have a value for. Where assets share a joint tree
/// (independent_units()), each tree counts once, with the mean of its differences: they are no independent samples.
PairedDifference difference_to_first(const Comparison& comparison, std::size_t method, const std::string& key);

/// Difference of every further method to the first, per headline metric, with interval and verdict.
Table difference_table(const Comparison& comparison);

}  // namespace anigen::eval
