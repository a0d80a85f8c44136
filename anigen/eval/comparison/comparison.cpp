#include "anigen/eval/comparison/comparison.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace anigen::eval {

std::vector<double> metric_values(const Comparison& comparison, std::size_t method, const std::string& key) {
  std::vector<double> values;
  for (const PairResult& result : comparison.results[method]) values.push_back(result.value(key));
  return values;
}

MetricSummary summarize_metric(const Comparison& comparison, std::size_t method, const std::string& key) {
  std::vector<double> values = metric_values(comparison, method, key);
  values.erase(std::remove_if(values.begin(), values.end(), [](double v) { return !std::isfinite(v); }), values.end());
  MetricSummary result;
  result.interval = bootstrap_mean(values, comparison.seed, key);
  result.summary = summarize(values);
  return result;
}

std::size_t failures(const Comparison& comparison, std::size_t method) {
  const auto& results = comparison.results[method];
  return static_cast<std::size_t>(
      std::count_if(results.begin(), results.end(), [](const PairResult& r) { return !r.failure.empty(); }));
}

std::vector<const MetricInfo*> present_metrics(const Comparison& comparison, bool headline) {
  std::vector<const MetricInfo*> result;
  for (const MetricInfo& info : metric_table()) {
    if (headline && !info.headline) continue;
    bool present = false;
    for (const auto& method : comparison.results) {
      present = present || std::any_of(method.begin(), method.end(),
                                       [&](const PairResult& r) { return r.values.find(info.key) != r.values.end(); });
    }
    if (present) result.push_back(&info);
  }
  return result;
}

std::vector<int> ranks(const Comparison& comparison, const MetricInfo& metric) {
  const std::size_t count = comparison.methods.size();
  std::vector<int> result(count, 0);
  if (count < 2 || metric.better == Better::kNeither) return result;
  // Means over different assets do not compare: a method that fails on the hard ones would win.
  std::vector<double> means(count);
  std::vector<bool> valued;
  for (std::size_t m = 0; m < count; ++m) {
    const std::vector<double> values = metric_values(comparison, m, metric.key);
    std::vector<bool> here;
    double sum = 0;
    std::size_t n = 0;
    for (const double value : values) {
      here.push_back(std::isfinite(value));
      if (std::isfinite(value)) sum += value, ++n;
    }
    if (n == 0 || (m > 0 && here != valued)) return result;
    valued = here;
    means[m] = sum / static_cast<double>(n);
  }
  return places(means, metric.better == Better::kLower);
}

}  // namespace anigen::eval
