#include "anigen/loaders/rigged_item.h"

#include <queue>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/loaders/files/rig_arrays.h"

namespace anigen::loaders {

std::size_t RiggedItem::bytes() const {
  return sizeof(*this) + joints.size() * (sizeof(joints[0]) + sizeof(int)) + vertices.size() * sizeof(vertices[0]) +
         faces.size() * sizeof(Triangle) + skin.offsets.size() * sizeof(std::size_t) +
         skin.influences.size() * sizeof(Influence);
}

std::vector<int> parents_first_order(const std::vector<int>& parents, const std::string& file) {
  const int count = static_cast<int>(parents.size());
  std::vector<std::vector<int>> children(parents.size());
  std::priority_queue<int, std::vector<int>, std::greater<int>> open;
  for (int j = 0; j < count; ++j) {
    const int parent = parents[static_cast<std::size_t>(j)];
    if (parent >= count || parent < -1 || parent == j) {
      throw InputError(file, "parents[" + std::to_string(j) + "]",
                       "is " + std::to_string(parent) + " among " + std::to_string(count) + " joints");
    }
    if (parent < 0)
      open.push(j);
    else
      children[static_cast<std::size_t>(parent)].push_back(j);
  }
  std::vector<int> order;
  while (!open.empty()) {
    order.push_back(open.top());
    open.pop();
    for (const int child : children[static_cast<std::size_t>(order.back())]) open.push(child);
  }
  if (order.size() != parents.size()) {
    throw InputError(file, "parents",
                     std::to_string(parents.size() - order.size()) + " joints are on or below a cycle");
  }
  return order;
}

RiggedItem read_rigged_item(const AssetId& asset, std::size_t max_joints) {
  RigArrays arrays = read_rig_arrays(asset, max_joints);
  RiggedItem item;
  item.id = asset.id;
  item.skin = from_dense(arrays.skin, arrays.vertices.size(), arrays.joints.size(), 0.0f, &item.unweighted);
  item.joints = std::move(arrays.joints);
  item.parents = std::move(arrays.parents);
  item.vertices = std::move(arrays.vertices);
  item.faces = std::move(arrays.faces);
  return item;
}

}  // namespace anigen::loaders
