#include "anigen/loaders/files/skin_rows.h"

#include <algorithm>

#include "anigen/loaders/rigged_item.h"

namespace anigen::loaders {

std::size_t normalize_skin_rows(std::vector<float>& skin, std::size_t joints) {
  std::size_t unweighted = 0;
  for (std::size_t first = 0; first < skin.size(); first += joints) {
    float* row = skin.data() + first;
    if (*std::max_element(row, row + joints) == 0.0f) {
      row[0] = 1.0f;
      ++unweighted;
    }
    float sum = 0.0f;
    for (std::size_t j = 0; j < joints; ++j) sum += row[j];
    for (std::size_t j = 0; j < joints; ++j) row[j] /= sum;
  }
  return unweighted;
}

void accumulate_skin_as_flow(std::vector<float>& skin, const std::vector<int>& parents) {
  const std::size_t joints = parents.size();
  const std::vector<int> order = parents_first_order(parents, "");
  const auto root = std::find(parents.begin(), parents.end(), -1) - parents.begin();
  std::vector<bool> below(joints, false);
  for (const int joint : order) {
    const auto j = static_cast<std::size_t>(joint);
    below[j] = joint == root || (parents[j] >= 0 && below[static_cast<std::size_t>(parents[j])]);
  }
  for (std::size_t first = 0; first < skin.size(); first += joints) {
    float* row = skin.data() + first;
    // Children before parents: a joint's column is complete before it is added to its parent's.
    for (auto joint = order.rbegin(); joint != order.rend(); ++joint) {
      const auto j = static_cast<std::size_t>(*joint);
      if (parents[j] >= 0 && below[j]) row[parents[j]] += row[j];
    }
    for (std::size_t j = 0; j < joints; ++j) row[j] = std::clamp(row[j], 0.0f, 1.0f);
  }
}

}  // namespace anigen::loaders
