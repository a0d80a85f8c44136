#include "anigen/core/numeric.h"

#include <algorithm>

namespace anigen {

double percentile(std::vector<float> values, double p) {
  const double place = p / 100.0 * static_cast<double>(values.size() - 1);
  const auto low = static_cast<std::size_t>(place);
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(low), values.end());
  const double a = values[low];
  if (low + 1 >= values.size()) return a;
  const double b = *std::min_element(values.begin() + static_cast<std::ptrdiff_t>(low) + 1, values.end());
  return a + (b - a) * (place - static_cast<double>(low));
}

}  // namespace anigen
