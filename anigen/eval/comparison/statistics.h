#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

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
  Interval interval;   ///< 95 %, by bootstrap over assets
  std::size_t n = 0;   ///< assets compared
  bool equal = false;  ///< numerically, on every one of them
};

/// @param first, second one entry per asset; NaN where a method has no value
PairedDifference paired_difference(const std::vector<double>& first, const std::vector<double>& second,
                                   std::uint64_t seed, const std::string& purpose);

}  // namespace anigen::eval
