#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/table.h"
#include "anigen/eval/metric_table.h"
#include "anigen/eval/pair.h"
#include "anigen/eval/pairs.h"
#include "anigen/eval/skin_evaluation.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/metrics/image.h"
#include "anigen/metrics/motion.h"

namespace anigen::eval {

/// A 95 % interval of a mean.
struct Interval {
  double low = 0, high = 0;
};

/// Percentile bootstrap of the mean (Efron 1979): `draws` resamples with replacement of the assets, from the
/// stream (seed, purpose), so the same values give the same interval. One value gives an interval without width.
/// @param values not empty, finite
Interval bootstrap_mean(const std::vector<double>& values, std::uint64_t seed, const std::string& purpose,
                        std::size_t draws = 2000);

/// True when two values differ by less than their inputs resolve: by at most 2^-23 (1.2e-7) of the larger one, or of 1.
/// Files hold positions and weights in single precision, which is that fine, and metrics are in units of the truth's
/// box; closer values differ by the order of a sum and not by the rigs. Every table compares values by this, through
/// difference() and places().
bool numerically_equal(double a, double b);

/// a − b, and 0 when they are numerically equal.
double difference(double a, double b);

/// Place of every mean: 1 best, 2 second, 0 for others and where there is no number. Numerically equal means share one.
std::vector<int> places(const std::vector<double>& means, bool lower_is_better);

/// Two methods on the assets both have a value for.
struct PairedDifference {
  double mean = 0;     ///< of difference(first, second)
  Interval interval;   ///< 95 %, by bootstrap over the entries
  std::size_t n = 0;   ///< entries compared: assets, or skeletons
  bool equal = false;  ///< numerically, on every one of them
};

/// @param first, second one entry per asset; NaN where a method has no value
PairedDifference paired_difference(const std::vector<double>& first, const std::vector<double>& second,
                                   std::uint64_t seed, const std::string& purpose);

/// Counts of ground truths with a prediction, and the names left over on both sides.
struct Pairing {
  std::size_t paired = 0;
  std::vector<std::string> missing;  ///< ground truths without a prediction
  std::vector<std::string> unused;   ///< predictions of none of the ground truths asked for, or of no row
};

/// Several predictions of the same ground truths.
struct Comparison {
  std::vector<std::string> methods;              ///< labels, at least one
  std::vector<std::string> ids;                  ///< one per ground truth, in its order
  std::vector<std::vector<PairResult>> results;  ///< [method][id]; a missing prediction is a failure, never left out
  std::vector<std::string> unused;               ///< "<method>: <id>" of predictions without a ground truth or row
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

/// metrics.json: `settings`; `methods`, one object per label with `summary` (key → mean, median, std, n, low, high),
/// `failed` and `assets` (id, values under their keys, `not_computed`, `notes`, `details`); `differences` of every
/// method to the first one (difference_to_first()). `summary` and `assets` of the first method stand at the top level
/// too.
Json to_json(const Comparison& comparison);

/// metrics.csv: one row per asset and method, a column per metric; a cell without value is empty, `failure` says why.
CsvTable to_csv_table(const Comparison& comparison);

/// One sentence on the transport solver when it is not the exact one; else empty.
std::string transport_text(const Comparison& comparison);

/// table.md: headline metrics, all metrics, differences, failures with their reasons, what was not computed and why.
std::string to_markdown(const Comparison& comparison);

/// table.tex: the headline metrics as a LaTeX tabular (booktabs); best in bold, second best underlined.
std::string to_latex(const Comparison& comparison);

/// Methods × metrics; best `**bold**` and second best `_underlined_` where they can be ranked. A cell of fewer assets
/// than the other columns tell has their number behind it.
/// @param with_failures columns of all and of failed assets
anigen::Table method_table(const Comparison& comparison, const std::vector<const MetricInfo*>& metrics,
                           bool with_failures = true);

/// Mean, median, interval and number of every metric of one method; "–" where no asset has a value.
anigen::Table metric_summary_table(const Comparison& comparison, std::size_t method);

/// Ground truths, pairs and what is left over on both sides, with counts and the first names; no row when the pairing
/// is not known.
anigen::Table pairing_table(const Comparison& comparison);

/// Failures and reasons for missing values, each once with the number of assets.
anigen::Table reason_table(const Comparison& comparison);

/// A file name for an id or a label: one that any system takes, and that no two of them share.
std::string file_name(const std::string& text);

/// One set of predictions under one name.
struct ComparedMethod {
  std::string label;
  std::shared_ptr<const io::ShapeSource> predictions, truths;
  std::vector<PairPlan> pairs;
};

struct ComparisonRun {
  PairSettings settings;
  /// Called from several threads; settings.lpips and settings.image_encoder describe them.
  metrics::PerceptualDistances perceptual;
  const CategoryReferences* categories = nullptr;  ///< settings.categories describes them
  const metrics::Motion* motion =
      nullptr;                     ///< that every truth is given in place of its own; settings.motion describes it
  std::filesystem::path cache;     ///< results of pairs, one file each: an interrupted run goes on from there
  bool resume = true;              ///< false: compute everything again
  bool accept_other_code = false;  ///< a saved result counts whatever build of the program made it
};

/// Evaluates every pair of every method, several at once (set_thread_count). Rows are those of the first method;
/// where another one has no pair of that id, that is a failure. What a pair throws is its failure and stops nothing.
/// A saved result counts only for equal shapes, settings and commit (core/version.h); how many are of another commit is
/// said once. Several processes with one `cache` share the
/// pairs by leases: each returns all results, of which it computed some and read the others.
/// @throws InputError without methods or pairs; Interrupted after Ctrl-C, with finished pairs saved
Comparison run_comparison(const std::vector<ComparedMethod>& methods, const ComparisonRun& run);

}  // namespace anigen::eval
