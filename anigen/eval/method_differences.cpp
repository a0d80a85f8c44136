#include "anigen/eval/method_differences.h"

#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "anigen/eval/skeleton_groups.h"

namespace anigen::eval {

namespace {

/// Resampling a handful of differences says nothing about others.
constexpr std::size_t kFewestForVerdict = 6;

/// Counts and figures of a rig by itself, which no registration changes.
bool needs_no_frame(const std::string& key) {
  return key == "joints" || key == "joint_count_error" || key == "tree_edit_distance" || key.rfind("sound_", 0) == 0;
}

/// Feature that an asset was registered by, or points that its motion was compared by; empty: not noted.
std::string measured_by(const PairResult& result, const std::string& key) {
  const bool motion = key.rfind("motion_distance", 0) == 0;
  const Json::json_pointer place(motion ? "/motion/distance" : "/alignment/by");
  if (!result.details.is_object() || !result.details.contains(place)) return "";
  const Json& word = result.details.at(place);
  return word.is_string() ? word.get<std::string>() : word.dump();
}

std::string verdict_of(const PairedDifference& difference, const MetricInfo& metric, bool alike, bool of_trees) {
  if (difference.equal) return "equal";
  if (!alike) return "measured in different ways";
  if (difference.n < kFewestForVerdict) return of_trees ? "too few skeletons to tell" : "too few assets to tell";
  if (difference.interval.low <= 0 && difference.interval.high >= 0) return "no clear difference";
  return (difference.mean < 0) == (metric.better == Better::kLower) ? "better" : "worse";
}

}  // namespace

bool measured_alike(const Comparison& comparison, std::size_t first, std::size_t second, const std::string& key) {
  const bool is_raw =
      comparison.settings.value("normalization", "") == "none" && comparison.settings.value("icp", Json()).is_null();
  if (is_raw || needs_no_frame(key)) return true;
  for (std::size_t i = 0; i < comparison.ids.size(); ++i) {
    const PairResult &a = comparison.results[first][i], &b = comparison.results[second][i];
    if (!std::isfinite(a.value(key)) || !std::isfinite(b.value(key))) continue;
    const std::string by_a = measured_by(a, key), by_b = measured_by(b, key);
    if (!by_a.empty() && !by_b.empty() && by_a != by_b) return false;
  }
  return true;
}

std::vector<int> ranks(const Comparison& comparison, const MetricInfo& metric) {
  const std::size_t count = comparison.methods.size();
  std::vector<int> result(count, 0);
  if (count < 2 || metric.better == Better::kNeither) return result;
  // Means over different assets do not compare: a method that fails on the hard ones would win.
  std::vector<double> means(count);
  std::vector<bool> valued;
  for (std::size_t m = 0; m < count; ++m) {
    std::vector<bool> here;
    double sum = 0;
    std::size_t n = 0;
    for (const double value : metric_values(comparison, m, metric.key)) {
      here.push_back(std::isfinite(value));
      if (std::isfinite(value)) sum += value, ++n;
    }
    if (n == 0 || (m > 0 && (here != valued || !measured_alike(comparison, 0, m, metric.key)))) return result;
    valued = here;
    means[m] = sum / static_cast<double>(n);
  }
  return places(means, metric.better == Better::kLower);
}

PairedDifference difference_to_first(const Comparison& comparison, std::size_t method, const std::string& key) {
  const std::vector<double> own = metric_values(comparison, method, key), first = metric_values(comparison, 0, key);
  const std::vector<std::string> units = independent_units(comparison);
  if (units.empty()) return paired_difference(own, first, comparison.seed, key);
  struct Sums {
    double own = 0.0, first = 0.0;
    std::size_t count = 0;
  };
  std::map<std::string, Sums> trees;
  for (std::size_t i = 0; i < units.size(); ++i) {
    if (!std::isfinite(own[i]) || !std::isfinite(first[i])) continue;
    Sums& sums = trees[units[i]];
    sums.own += own[i];
    sums.first += first[i];
    ++sums.count;
  }
  std::vector<double> own_means, first_means;
  for (const auto& [unit, sums] : trees) {
    own_means.push_back(sums.own / static_cast<double>(sums.count));
    first_means.push_back(sums.first / static_cast<double>(sums.count));
  }
  return paired_difference(own_means, first_means, comparison.seed, key);
}

Table difference_table(const Comparison& comparison) {
  const bool of_trees = !independent_units(comparison).empty();
  Table table{{"method", "metric", "mean difference", "95 %", of_trees ? "skeletons" : "assets", "reads"}, {}};
  for (std::size_t m = 1; m < comparison.methods.size(); ++m) {
    for (const MetricInfo* metric : present_metrics(comparison, true)) {
      const PairedDifference difference = difference_to_first(comparison, m, metric->key);
      if (difference.n == 0) continue;
      const int places = table_digits(*metric);
      table.rows.push_back({comparison.methods[m] + " − " + comparison.methods[0], column_head(*metric),
                            fixed(difference.mean, places),
                            fixed(difference.interval.low, places) + " – " + fixed(difference.interval.high, places),
                            std::to_string(difference.n),
                            verdict_of(difference, *metric, measured_alike(comparison, 0, m, metric->key), of_trees)});
    }
  }
  return table;
}

}  // namespace anigen::eval
