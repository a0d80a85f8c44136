#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/csv.h"
#include "anigen/core/json.h"
#include "anigen/eval/comparison/statistics.h"
#include "anigen/eval/pair/metric_table.h"
#include "anigen/eval/pair/pair_result.h"
#include "anigen/eval/skin_evaluation.h"
#include "anigen/eval/tables.h"

namespace anigen::eval {

/// Counts of ground truths with a prediction, and the names left over on both sides.
struct Pairing {
  std::size_t paired = 0;
  std::vector<std::string> missing;  ///< ground truths without a prediction
  std::vector<std::string> unused;   ///< predictions that belong to none of the ground truths asked for
};

/// Several predictions of the same ground truths.
struct Comparison {
  std::vector<std::string> methods;              ///< labels, at least one
  std::vector<std::string> ids;                  ///< one per ground truth, in its order
  std::vector<std::vector<PairResult>> results;  ///< [method][id]; a missing prediction is a failure, never left out
  std::vector<std::string> unused;               ///< "<method>: <id>" of predictions without a ground truth
  std::vector<Pairing> pairing;                  ///< one per method; empty: not known
  Json settings = Json::object();                ///< everything that decides a number
  std::uint64_t seed = 0;                        ///< of the bootstrap intervals
};

/// The values of one metric, one per id; NaN where there is none.
std::vector<double> metric_values(const Comparison& comparison, std::size_t method, const std::string& key);

/// Mean, median, standard deviation and number, with the interval of the mean.
struct MetricSummary {
  Summary summary;
  Interval interval;
};
MetricSummary summarize_metric(const Comparison& comparison, std::size_t method, const std::string& key);

/// Assets that failed as a whole.
std::size_t failures(const Comparison& comparison, std::size_t method);

/// Metrics that at least one method has a value for, in the order of metric_table(). @param headline only those of
/// the short table
std::vector<const MetricInfo*> present_metrics(const Comparison& comparison, bool headline);

/// Rank of every method by mean: 1 for the best, 2 for the second; 0 for the others, and where nothing can be ranked
/// (one method, no direction, different assets have values).
std::vector<int> ranks(const Comparison& comparison, const MetricInfo& metric);

}  // namespace anigen::eval
