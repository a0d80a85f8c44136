#include "anigen/loaders/balanced_groups.h"

#include <algorithm>
#include <numeric>
#include <string>

#include "anigen/core/error.h"

namespace anigen::loaders {

std::vector<std::vector<std::size_t>> balanced_groups(const std::vector<std::uint64_t>& loads, std::size_t groups,
                                                      bool equal_size) {
  if (groups == 0) throw InputError("", "balanced groups", "there must be at least one group");
  if (equal_size && loads.size() % groups != 0) {
    throw InputError("", "balanced groups",
                     std::to_string(loads.size()) + " items cannot be dealt into " + std::to_string(groups) +
                         " groups of equal size");
  }
  const std::size_t room = equal_size ? loads.size() / groups : loads.size();
  std::vector<std::size_t> order(loads.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return loads[a] > loads[b]; });

  std::vector<std::vector<std::size_t>> result(groups);
  std::vector<std::uint64_t> total(groups, 0);
  for (const std::size_t item : order) {
    std::size_t lightest = groups;
    for (std::size_t g = 0; g < groups; ++g) {
      if (result[g].size() < room && (lightest == groups || total[g] < total[lightest])) lightest = g;
    }
    result[lightest].push_back(item);
    total[lightest] += loads[item];
  }
  return result;
}

}  // namespace anigen::loaders
