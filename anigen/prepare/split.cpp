#include "anigen/prepare/split.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/random.h"

namespace anigen::prepare {

std::vector<bool> choose_test(const std::vector<std::string>& ids, std::size_t count, std::uint64_t seed) {
  std::vector<std::pair<std::uint64_t, std::size_t>> ranked;
  for (std::size_t i = 0; i < ids.size(); ++i) ranked.emplace_back(stable_hash("split/" + ids[i], seed), i);
  std::sort(ranked.begin(), ranked.end(), [&](const auto& a, const auto& b) {
    return a.first != b.first ? a.first < b.first : ids[a.second] < ids[b.second];
  });
  std::vector<bool> test(ids.size(), false);
  for (std::size_t i = 0; i < std::min(count, ranked.size()); ++i) test[ranked[i].second] = true;
  return test;
}

std::size_t test_count(std::size_t n, double fraction) {
  if (!(fraction >= 0.0 && fraction <= 1.0)) {
    throw InputError("", "--test-fraction", "must lie in [0, 1], got " + std::to_string(fraction));
  }
  return static_cast<std::size_t>(std::lround(fraction * static_cast<double>(n)));
}

}  // namespace anigen::prepare
