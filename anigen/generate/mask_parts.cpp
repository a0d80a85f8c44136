#include "anigen/generate/mask_parts.h"

#include <algorithm>
#include <cstddef>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::generate {

void drop_small_parts(std::vector<std::uint8_t>& mask, int width, int height, double share) {
  if (width < 0 || height < 0 || mask.size() != at(width) * at(height))
    throw InputError("", "mask", "its pixels do not fit its size");
  DisjointSets parts(mask.size());
  const std::size_t row = at(width);
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if (mask[i] == 0) continue;
    const std::size_t x = i % row;
    const auto join_if_set = [&](std::size_t other) {
      if (mask[other] != 0) parts.join_lowest(other, i);
    };
    if (x > 0) join_if_set(i - 1);
    if (i < row) continue;
    join_if_set(i - row);
    if (x > 0) join_if_set(i - row - 1);
    if (x + 1 < row) join_if_set(i - row + 1);
  }
  std::size_t largest = 0;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if (mask[i] != 0) largest = std::max(largest, parts.size_of(i));
  }
  const double least = share * static_cast<double>(largest);
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if (mask[i] != 0 && static_cast<double>(parts.size_of(i)) < least) mask[i] = 0;
  }
}

}  // namespace anigen::generate
