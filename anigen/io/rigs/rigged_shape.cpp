#include "anigen/io/rigs/rigged_shape.h"

#include <set>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::io {

RiggedShape rigged_shape(Asset asset, const std::string& id, const std::string& file) {
  RiggedShape shape;
  shape.id = id;
  shape.file = file;
  shape.joints = joint_tree(asset.skeleton);
  shape.joint_names = asset.skeleton.names;
  if (!asset.animations.empty())
    shape.clips = std::make_shared<RigClips>(RigClips{std::move(asset.skeleton), std::move(asset.animations)});
  shape.mesh = std::move(asset.mesh);
  shape.materials = std::move(asset.materials);
  shape.images = std::move(asset.images);
  shape.skin = std::move(asset.skin);
  return shape;
}

Asset to_asset(const RiggedShape& shape) {
  check(shape.joints, shape.file);
  const JointTree tree = connected(shape.joints);
  std::vector<std::vector<int>> children(tree.size());
  std::vector<int> order;  // parents first
  for (std::size_t j = 0; j < tree.size(); ++j) {
    if (tree.parents[j] < 0)
      order.push_back(static_cast<int>(j));
    else
      children[static_cast<std::size_t>(tree.parents[j])].push_back(static_cast<int>(j));
  }
  for (std::size_t i = 0; i < order.size(); ++i) {
    for (const int child : children[static_cast<std::size_t>(order[i])]) order.push_back(child);
  }
  std::vector<int> place(tree.size());
  for (std::size_t i = 0; i < order.size(); ++i) place[static_cast<std::size_t>(order[i])] = static_cast<int>(i);

  std::vector<Eigen::Vector3d> positions;
  std::vector<int> parents;
  std::vector<std::string> names;
  std::set<std::string> taken;
  for (const int j : order) {
    const auto joint = static_cast<std::size_t>(j);
    positions.push_back(tree.positions[joint]);
    parents.push_back(tree.parents[joint] < 0 ? -1 : place[static_cast<std::size_t>(tree.parents[joint])]);
    std::string name = joint < shape.joint_names.size() ? shape.joint_names[joint] : "";
    for (std::size_t k = joint; name.empty() || !taken.insert(name).second; k += tree.size())
      name = "joint_" + std::to_string(k);
    names.push_back(std::move(name));
  }
  Asset asset;
  asset.name = shape.id;
  asset.mesh = shape.mesh;
  asset.materials = shape.materials;
  asset.images = shape.images;
  asset.skeleton = skeleton_from_joints(positions, parents, names);
  asset.skin = shape.skin;
  for (Influence& influence : asset.skin.influences)
    influence.joint = static_cast<std::int32_t>(place[static_cast<std::size_t>(influence.joint)]);
  return asset;
}

}  // namespace anigen::io
