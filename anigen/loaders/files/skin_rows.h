#pragma once
#include <cstddef>
#include <vector>

namespace anigen::loaders {

/// Rows whose largest weight is exactly 0 get weight 1 on joint 0; then each row is divided by its sum (reference
/// training-and-data.md, 1.4, skeleton pack). @param skin [V, J] row-major, finite, ≥ 0
/// @return how many rows had no weight
std::size_t normalize_skin_rows(std::vector<float>& skin, std::size_t joints);

/// `skin_accum_as_flow`: replaces each joint's column by the sum over its subtree, from the first root downwards,
/// clipped to [0, 1]. Joints that do not hang from the first root keep their own weights, clipped too.
/// @param skin [V, J] row-major @param parents [J], -1 for a root, no cycles
void accumulate_skin_as_flow(std::vector<float>& skin, const std::vector<int>& parents);

}  // namespace anigen::loaders
