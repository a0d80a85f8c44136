#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace anigen::loaders {

/// Deals items into groups of similar total load by the longest-processing-time rule (Graham 1969): items by falling
/// load, each to the group that is lightest so far, the first of several (reference training-and-data.md, 1.4,
/// collation). Equal loads keep their order.
/// @param groups at least 1 @param equal_size a group with loads.size() / groups items takes no more; the number of
/// items must then be a multiple of groups @return item indices per group, by falling load
/// @throws InputError when it is not, or groups is 0
std::vector<std::vector<std::size_t>> balanced_groups(const std::vector<std::uint64_t>& loads, std::size_t groups,
                                                      bool equal_size = false);

}  // namespace anigen::loaders
