#include "anigen/studio/rebind.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/engine/rig.h"

namespace anigen::studio {

namespace {

constexpr const char* kPlace = "joints";
constexpr std::size_t kMostJoints = 1000, kLongestName = 200;

constexpr double kSamePlace = 1e-5;  // of the mesh's diagonal

/// Joint per joint of another skeleton, of the same name; -1: there is none.
std::vector<int> namesakes(const Skeleton& of, const Skeleton& in) {
  std::map<std::string, int> numbers;
  for (std::size_t j = 0; j < in.size(); ++j) numbers[in.names[j]] = static_cast<int>(j);
  std::vector<int> found;
  for (const std::string& name : of.names) {
    const auto one = numbers.find(name);
    found.push_back(one == numbers.end() ? -1 : one->second);
  }
  return found;
}

/// Both have the same joints at the same places below the same parents. @param to joint of `b` per joint of `a`
bool are_alike(const Skeleton& a, const Skeleton& b, const std::vector<int>& to, double near) {
  if (a.size() != b.size()) return false;
  const std::vector<Eigen::Vector3d> places = a.positions(), others = b.positions();
  for (std::size_t j = 0; j < a.size(); ++j) {
    if (to[j] < 0) return false;
    const int parent = a.parents[j] < 0 ? -1 : to[at(a.parents[j])];
    if (b.parents[at(to[j])] != parent || (places[j] - others[at(to[j])]).norm() > near) return false;
  }
  return true;
}

}  // namespace

Eigen::Vector3d world_position(const std::vector<double>& values, const ConfigReader& reader, const std::string& key) {
  if (values.size() != 3) throw reader.error(key, "has " + std::to_string(values.size()) + " numbers, not 3");
  for (const double value : values)
    if (!std::isfinite(value) || std::abs(value) > 1e9) throw reader.error(key, "is too far away");
  return {values[0], -values[2], values[1]};
}

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
    tree.positions.push_back(world_position(reader.numbers("position", {}), reader, "position"));
    reader.text("was", "");  // with_former_names() uses it
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

Skeleton with_former_names(Skeleton skeleton, const Json& joints) {
  std::map<std::string, std::string> former;
  std::set<std::string> seen;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const std::string name = joints[j].at("name"), was = joints[j].value("was", name);
    if (!seen.insert(was).second)
      throw InputError(kPlace, "/" + std::to_string(j) + "/was", "\"" + was + "\" is there twice");
    former[name] = was;
  }
  for (std::string& name : skeleton.names) name = former.at(name);
  return skeleton;
}

void rename_joints(const Skeleton& former, const std::vector<std::string>& names, Asset& asset) {
  std::map<std::string, std::string> now;
  for (std::size_t j = 0; j < former.size(); ++j) now[former.names[j]] = names[j];
  for (std::string& name : asset.skeleton.names) name = now.at(name);
}

bool has_joints(const Asset& asset, const Skeleton& skeleton) {
  const std::vector<int> own = namesakes(skeleton, asset.skeleton);
  return std::find(own.begin(), own.end(), -1) == own.end();
}

Rebound with_kept_weights(const Asset& asset, const Skeleton& skeleton) {
  const auto started = std::chrono::steady_clock::now();
  const std::vector<int> own = namesakes(skeleton, asset.skeleton);
  const auto unknown = std::find(own.begin(), own.end(), -1);
  if (unknown != own.end())
    throw InputError(kPlace, "",
                     "\"" + skeleton.names[static_cast<std::size_t>(unknown - own.begin())] +
                         "\" is no joint of the rig, which has no weights to keep for it");
  std::vector<int> to = namesakes(asset.skeleton, skeleton);
  Rebound kept{asset, 0.0};
  if (!are_alike(asset.skeleton, skeleton, to, kSamePlace * bounding_box(asset.mesh.vertices).diagonal())) {
    for (std::size_t j = 0; j < to.size(); ++j) {  // parents come first
      const int parent = asset.skeleton.parents[j];
      if (to[j] < 0) to[j] = parent < 0 ? 0 : to[at(parent)];
    }
    kept.asset.animations.clear();
    kept.asset.skeleton = skeleton;
    kept.asset.skin = SkinWeights();
    for (std::size_t v = 0; v < asset.skin.rows(); ++v) {
      std::vector<Influence> row(asset.skin.row(v), asset.skin.row(v) + asset.skin.row_size(v));
      for (Influence& influence : row) influence.joint = to[at(influence.joint)];
      kept.asset.skin.append_row(std::move(row));
    }
  }
  kept.milliseconds = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - started).count();
  return kept;
}

}  // namespace anigen::studio
