#include "anigen/eval/comparison/statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "anigen/core/random.h"

namespace anigen::eval {

Interval bootstrap_mean(const std::vector<double>& values, std::uint64_t seed, const std::string& purpose,
                        std::size_t draws) {
  const std::size_t n = values.size();
  if (n == 0 || draws == 0) return {};
  Rng rng(seed, "bootstrap " + purpose);
  std::vector<double> means(draws);
  for (double& mean : means) {
    double sum = 0;
    for (std::size_t i = 0; i < n; ++i) sum += values[rng.index(n)];
    mean = sum / static_cast<double>(n);
  }
  std::sort(means.begin(), means.end());
  const auto at = [&](double quantile) {
    return means[static_cast<std::size_t>(std::lround(quantile * static_cast<double>(draws - 1)))];
  };
  return {at(0.025), at(0.975)};
}

bool numerically_equal(double a, double b) {
  constexpr double kSinglePrecision = std::numeric_limits<float>::epsilon();
  return std::abs(a - b) <= kSinglePrecision * std::max({1.0, std::abs(a), std::abs(b)});
}

double difference(double a, double b) { return numerically_equal(a, b) ? 0.0 : a - b; }

std::vector<int> places(const std::vector<double>& means, bool lower_is_better) {
  std::vector<int> result(means.size(), 0);
  for (std::size_t m = 0; m < means.size(); ++m) {
    if (!std::isfinite(means[m])) continue;
    const auto better = std::count_if(means.begin(), means.end(), [&](double other) {
      return std::isfinite(other) && (lower_is_better ? difference(other, means[m]) : difference(means[m], other)) < 0;
    });
    if (better < 2) result[m] = static_cast<int>(better) + 1;
  }
  return result;
}

PairedDifference paired_difference(const std::vector<double>& first, const std::vector<double>& second,
                                   std::uint64_t seed, const std::string& purpose) {
  std::vector<double> differences;
  for (std::size_t i = 0; i < std::min(first.size(), second.size()); ++i) {
    if (std::isfinite(first[i]) && std::isfinite(second[i])) differences.push_back(difference(first[i], second[i]));
  }
  PairedDifference result;
  result.n = differences.size();
  if (result.n == 0) return result;
  result.equal = std::all_of(differences.begin(), differences.end(), [](double d) { return d == 0.0; });
  result.mean = std::accumulate(differences.begin(), differences.end(), 0.0) / static_cast<double>(result.n);
  result.interval = bootstrap_mean(differences, seed, "difference " + purpose);
  return result;
}

}  // namespace anigen::eval
