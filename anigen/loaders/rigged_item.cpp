#include "anigen/loaders/rigged_item.h"

#include <cmath>
#include <cstdint>
#include <queue>

#include "anigen/core/error.h"
#include "anigen/io/npz.h"

namespace anigen::loaders {
namespace {

using io::NdArray;

const NdArray& array(const io::NamedArrays& arrays, const std::string& file, const char* name,
                     const std::vector<std::int64_t>& shape) {
  const NdArray* found = io::find(arrays, name);
  if (found == nullptr) throw InputError(file, name, "no such array");
  bool fits = found->shape.size() == shape.size();
  for (std::size_t i = 0; fits && i < shape.size(); ++i) fits = shape[i] < 0 || shape[i] == found->shape[i];
  if (!fits) {
    std::string expected, actual;
    for (const std::int64_t n : shape) expected += (expected.empty() ? "" : ", ") + (n < 0 ? "*" : std::to_string(n));
    for (const std::int64_t n : found->shape) actual += (actual.empty() ? "" : ", ") + std::to_string(n);
    throw InputError(file, name, "has shape [" + actual + "], expected [" + expected + "]");
  }
  return *found;
}

std::vector<Eigen::Vector3f> points(const NdArray& values, const std::string& file, const char* name) {
  const std::vector<float> flat = values.as<float>();
  std::vector<Eigen::Vector3f> result(flat.size() / 3);
  for (std::size_t i = 0; i < result.size(); ++i) {
    result[i] = {flat[3 * i], flat[3 * i + 1], flat[3 * i + 2]};
    if (!result[i].allFinite())
      throw InputError(file, std::string(name) + "[" + std::to_string(i) + "]", "is not finite");
  }
  return result;
}

std::vector<Triangle> triangles(const NdArray& values, std::size_t vertices, const std::string& file) {
  const std::vector<std::int64_t> flat = values.as<std::int64_t>();
  std::vector<Triangle> result(flat.size() / 3);
  for (std::size_t i = 0; i < flat.size(); ++i) {
    if (flat[i] < 0 || flat[i] >= static_cast<std::int64_t>(vertices)) {
      throw InputError(file, "faces[" + std::to_string(i / 3) + "]",
                       "vertex " + std::to_string(flat[i]) + " of " + std::to_string(vertices));
    }
    result[i / 3][i % 3] = static_cast<std::int32_t>(flat[i]);
  }
  return result;
}

SkinWeights sparse_skin(const NdArray& values, std::size_t vertices, std::size_t joints, const std::string& file) {
  const std::vector<float> dense = values.as<float>();
  for (std::size_t i = 0; i < dense.size(); ++i) {
    if (!(dense[i] >= 0.0f) || !std::isfinite(dense[i])) {
      throw InputError(file, "skin[" + std::to_string(i / joints) + ", " + std::to_string(i % joints) + "]",
                       "is " + std::to_string(dense[i]) + "; weights must be finite and not negative");
    }
  }
  return from_dense(dense, vertices, joints);
}

}  // namespace

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
  const std::filesystem::path path = asset.root / "skeleton" / asset.id / "skeleton_voxelized.npz";
  const std::string file = path.string();
  const io::NamedArrays arrays = io::read_npz(path, {"joints", "parents", "skin", "vertices", "faces"});
  RiggedItem item;
  item.id = asset.id;
  item.joints = points(array(arrays, file, "joints", {-1, 3}), file, "joints");
  const std::size_t joint_count = item.joints.size();
  if (joint_count == 0 || joint_count > max_joints) {
    throw InputError(
        file, "joints",
        std::to_string(joint_count) + " joints; between 1 and " + std::to_string(max_joints) + " are possible");
  }
  for (const std::int64_t parent :
       array(arrays, file, "parents", {static_cast<std::int64_t>(joint_count)}).as<std::int64_t>()) {
    // Anything outside the joints stays outside when it is narrowed; the check of the tree below reports it.
    item.parents.push_back(parent < -1 || parent > 1'000'000 ? 1'000'000 : static_cast<int>(parent));
  }
  parents_first_order(item.parents, file);
  item.vertices = points(array(arrays, file, "vertices", {-1, 3}), file, "vertices");
  item.faces = triangles(array(arrays, file, "faces", {-1, 3}), item.vertices.size(), file);
  if (item.faces.empty()) throw InputError(file, "faces", "is empty");
  const std::vector<std::int64_t> skin_shape{static_cast<std::int64_t>(item.vertices.size()),
                                             static_cast<std::int64_t>(joint_count)};
  item.skin = sparse_skin(array(arrays, file, "skin", skin_shape), item.vertices.size(), joint_count, file);
  return item;
}

}  // namespace anigen::loaders
