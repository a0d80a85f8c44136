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

/// Two methods on the assets both have a value for.
struct PairedDifference {
  double mean = 0;    ///< of first − second
  Interval interval;  ///< 95 %, by bootstrap over assets
  std::size_t n = 0;  ///< assets compared
};

/// @param first, second one entry per asset; NaN where a method has no value
PairedDifference paired_difference(const std::vector<double>& first, const std::vector<double>& second,
                                   std::uint64_t seed, const std::string& purpose);

}  // namespace anigen::eval
