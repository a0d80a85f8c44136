#include "anigen/studio/rebind.h"

#include <cmath>
#include <set>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/engine/rig.h"

namespace anigen::studio {

namespace {

constexpr const char* kPlace = "joints";
constexpr std::size_t kMostJoints = 1000, kLongestName = 200;

Eigen::Vector3d world_position(const std::vector<double>& values, const ConfigReader& reader) {
  if (values.size() != 3) throw reader.error("position", "has " + std::to_string(values.size()) + " numbers, not 3");
  for (const double value : values)
    if (!std::isfinite(value) || std::abs(value) > 1e9) throw reader.error("position", "is too far away");
  return {values[0], -values[2], values[1]};
}

}  // namespace

Skeleton skeleton_of_joints(const Json& joints) {
  if (!joints.is_array() || joints.empty()) throw InputError(kPlace, "", "is no list of joints");
  if (joints.size() > kMostJoints)
    throw InputError(kPlace, "",
                     "has " + std::to_string(joints.size()) + " joints, more than " + std::to_string(kMostJoints));
  JointTree tree;
  std::vector<std::string> names;
  std::set<std::string> seen;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    ConfigReader reader(joints[j], kPlace, "/" + std::to_string(j));
    for (const char* key : {"name", "parent", "position"}) reader.require(key);
    const std::string name = reader.text("name", "");
    if (name.empty() || name.size() > kLongestName) throw reader.error("name", "is empty or too long");
    if (!seen.insert(name).second) throw reader.error("name", "\"" + name + "\" is there twice");
    names.push_back(name);
    tree.parents.push_back(static_cast<int>(reader.integer("parent", -1, -1, static_cast<int>(joints.size()) - 1)));
    tree.positions.push_back(world_position(reader.numbers("position", {}), reader));
    reader.finish();
  }
  check(tree, kPlace);
  if (roots(tree).size() != 1)
    throw InputError(kPlace, "", "has " + std::to_string(roots(tree).size()) + " roots, not one");
  const std::vector<int> order = parents_first(tree);
  std::vector<int> row(order.size()), parents;
  std::vector<Eigen::Vector3d> positions;
  std::vector<std::string> ordered;
  for (std::size_t i = 0; i < order.size(); ++i) row[static_cast<std::size_t>(order[i])] = static_cast<int>(i);
  for (const int j : order) {
    const auto joint = static_cast<std::size_t>(j);
    const int parent = tree.parents[joint];
    parents.push_back(parent < 0 ? -1 : row[static_cast<std::size_t>(parent)]);
    positions.push_back(tree.positions[joint]);
    ordered.push_back(names[joint]);
  }
  return skeleton_from_joints(positions, parents, ordered);
}

Rebound rebound(const Asset& asset, const Skeleton& skeleton, const std::string& binding, Job* job) {
  if (binding != "heat" && binding != "geovoxel" && binding != "nearest")
    throw InputError("", "method", "\"" + binding + "\" is none of heat, geovoxel, nearest");
  Asset mesh = asset;
  mesh.animations.clear();
  mesh.skeleton = skeleton;
  // Weights that the new ones replace; a skeleton without any would not count.
  mesh.skin = SkinWeights();
  for (std::size_t v = 0; v < mesh.mesh.vertices.size(); ++v) mesh.skin.append_row({{0, 1.0F}});
  engine::RigOptions options;
  options.method = binding;
  engine::Rigged rigged = engine::rig(mesh, options, job);
  return {std::move(rigged.asset), 1000.0 * rigged.seconds};
}

}  // namespace anigen::studio
