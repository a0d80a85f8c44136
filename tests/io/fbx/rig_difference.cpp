#include "tests/io/fbx/rig_difference.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::test {

namespace {

struct Corner {
  std::string material;
  int number;
  std::size_t vertex;
};

/// Corners in the order of the names of their materials, then of the materials, then of the faces.
std::vector<Corner> corners_by_material(const Asset& asset) {
  const Mesh& mesh = asset.mesh;
  std::vector<Corner> corners;
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    const int material = mesh.face_materials.empty() ? -1 : mesh.face_materials[f];
    for (const std::int32_t v : mesh.faces[f])
      corners.push_back({material < 0 ? "default" : asset.materials[at(material)].name, material, at(v)});
  }
  std::stable_sort(corners.begin(), corners.end(), [](const Corner& a, const Corner& b) {
    return a.material != b.material ? a.material < b.material : a.number < b.number;
  });
  return corners;
}

std::map<std::string, double> weights_by_name(const Asset& asset, std::size_t vertex) {
  std::map<std::string, double> weights;
  for (std::size_t i = 0; i < asset.skin.row_size(vertex); ++i) {
    const Influence& influence = asset.skin.row(vertex)[i];
    weights[asset.skeleton.names[at(influence.joint)]] += static_cast<double>(influence.weight);
  }
  return weights;
}

double largest_difference(std::map<std::string, double> a, const std::map<std::string, double>& b) {
  for (const auto& [name, weight] : b) a[name] -= weight;
  double largest = 0.0;
  for (const auto& [name, weight] : a) largest = std::max(largest, std::abs(weight));
  return largest;
}

/// For each joint of `before` its number in `after`, -1 where there is none of the name.
std::vector<int> matched_joints(const Skeleton& before, const Skeleton& after) {
  std::map<std::string, int> by_name;
  for (std::size_t j = 0; j < after.size(); ++j) by_name[after.names[j]] = static_cast<int>(j);
  std::vector<int> matched;
  for (const std::string& name : before.names) matched.push_back(by_name.count(name) == 0 ? -1 : by_name[name]);
  return matched;
}

std::string parent_name(const Skeleton& skeleton, std::size_t joint) {
  const int parent = skeleton.parents[joint];
  return parent < 0 ? "" : skeleton.names[at(parent)];
}

void compare_corners(const Asset& before, const Asset& after, double size, RigDifference& difference) {
  const std::vector<Corner> was = corners_by_material(before), is = corners_by_material(after);
  const auto number = [&](double& largest, const auto& a, const auto& b, std::size_t v, std::size_t w) {
    if (!a.empty() && !b.empty())
      largest = std::max(largest, static_cast<double>((a[v] - b[w]).cwiseAbs().maxCoeff()));
    else if (a.empty() != b.empty())
      largest = INFINITY;
  };
  for (std::size_t c = 0; c < was.size(); ++c) {
    const std::size_t v = was[c].vertex, w = is[c].vertex;
    const double distance =
        (before.mesh.vertices[v].cast<double>() - after.mesh.vertices[w].cast<double>()).norm() / size;
    difference.vertices = std::max(difference.vertices, distance);
    number(difference.normals, before.mesh.normals, after.mesh.normals, v, w);
    number(difference.uvs, before.mesh.uvs, after.mesh.uvs, v, w);
    number(difference.colors, before.mesh.colors, after.mesh.colors, v, w);
    if (before.skin.rows() > 0 && after.skin.rows() > 0)
      difference.weights =
          std::max(difference.weights, largest_difference(weights_by_name(before, v), weights_by_name(after, w)));
  }
}

void compare_clips(const Asset& before, const Asset& after, const std::vector<int>& joints, double size,
                   std::size_t samples, RigDifference& difference) {
  if (before.animations.size() != after.animations.size()) {
    difference.broken.push_back(std::to_string(before.animations.size()) + " clips became " +
                                std::to_string(after.animations.size()));
    return;
  }
  for (std::size_t a = 0; a < before.animations.size(); ++a) {
    const Animation &was = before.animations[a], &is = after.animations[a];
    if (was.name != is.name) difference.broken.push_back("clip " + was.name + " became " + is.name);
    difference.clip_seconds = std::max(difference.clip_seconds, std::abs(was.duration() - is.duration()));
    for (std::size_t s = 0; s < samples; ++s) {
      const double time =
          was.duration() * static_cast<double>(s) / static_cast<double>(std::max<std::size_t>(1, samples - 1));
      const auto one = forward_kinematics(before.skeleton.parents, sample(was, before.skeleton, time));
      const auto other = forward_kinematics(after.skeleton.parents, sample(is, after.skeleton, time));
      for (std::size_t j = 0; j < joints.size(); ++j) {
        const double distance =
            (one[j].topRightCorner<3, 1>() - other[at(joints[j])].topRightCorner<3, 1>()).norm() / size;
        difference.moving_joints = std::max(difference.moving_joints, distance);
      }
    }
  }
}

}  // namespace

RigDifference rig_difference(const Asset& original, const Asset& after, std::size_t influences, std::size_t samples) {
  Asset before = original;
  if (before.skin.rows() > 0) before.skin = limit_influences(before.skin, influences);
  RigDifference difference;
  Box box = bounding_box(before.mesh.vertices);
  if (box.empty()) {
    for (const Eigen::Vector3d& place : before.skeleton.positions()) box.extend(place);
  }
  const double size = std::max(box.diagonal(), 1e-9);
  const auto expect = [&](std::size_t was, std::size_t is, const std::string& what) {
    if (was != is) difference.broken.push_back(std::to_string(was) + " " + what + " became " + std::to_string(is));
    return was == is;
  };
  if (expect(before.mesh.faces.size(), after.mesh.faces.size(), "faces"))
    compare_corners(before, after, size, difference);
  expect(distinct_vertices(before), after.mesh.vertices.size(), "distinct vertices");
  if (!expect(before.skeleton.size(), after.skeleton.size(), "joints")) return difference;
  const std::vector<int> joints = matched_joints(before.skeleton, after.skeleton);
  const std::vector<Eigen::Vector3d> was = before.skeleton.positions(), is = after.skeleton.positions();
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (joints[j] < 0) {
      difference.broken.push_back("joint " + before.skeleton.names[j] + " is gone");
      return difference;
    }
    if (parent_name(before.skeleton, j) != parent_name(after.skeleton, at(joints[j])))
      difference.broken.push_back("joint " + before.skeleton.names[j] + " has another parent");
    difference.bind_positions = std::max(difference.bind_positions, (was[j] - is[at(joints[j])]).norm() / size);
  }
  compare_clips(before, after, joints, size, samples, difference);
  return difference;
}

std::size_t distinct_vertices(const Asset& asset) {
  std::set<std::vector<double>> known;
  for (const Corner& corner : corners_by_material(asset)) {
    const std::size_t v = corner.vertex;
    std::vector<double> key{static_cast<double>(corner.number)};
    const auto add = [&key](const auto& numbers) {
      for (const float x : numbers) key.push_back(static_cast<double>(x));
    };
    add(asset.mesh.vertices[v]);
    if (!asset.mesh.normals.empty()) add(asset.mesh.normals[v]);
    if (!asset.mesh.uvs.empty()) add(asset.mesh.uvs[v]);
    if (!asset.mesh.colors.empty()) add(asset.mesh.colors[v]);
    for (std::size_t i = 0; i < (asset.skin.rows() > 0 ? asset.skin.row_size(v) : 0); ++i) {
      key.push_back(static_cast<double>(asset.skin.row(v)[i].joint));
      key.push_back(static_cast<double>(asset.skin.row(v)[i].weight));
    }
    known.insert(std::move(key));
  }
  return known.size();
}

}  // namespace anigen::test
