#pragma once
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/numeric.h"

namespace anigen::test {

/// A body of closed tubes with 15 joints: a trunk, two arms, two legs, two feet, 1 high and wide, facing −Y, left +X.
/// Weights pass from joint to joint along each tube by a smooth step, as painted ones do: a rig without defects.
class Doll {
 public:
  /// @param thickness factor of all radii
  explicit Doll(double thickness = 1.0) : thickness_(thickness) {
    const int hips = joint("hips", -1, {0, 0, -0.08}), spine = joint("spine", hips, {0, 0, 0.1});
    const int head = joint("head", spine, {0, 0, 0.32});
    tube({0, 0, -0.1}, {0, 0, 0.5}, 0.09, 36, {hips, spine, head}, {0.2, 0.42}, 0.05);
    for (const int side : {1, -1}) {
      const std::string end = side > 0 ? ".L" : ".R";
      const int upper_arm = joint("upper_arm" + end, spine, {side * 0.1, 0, 0.26});
      const int lower_arm = joint("lower_arm" + end, upper_arm, {side * 0.3, 0, 0.26});
      const int upper_leg = joint("upper_leg" + end, hips, {side * 0.05, 0, -0.1});
      const int lower_leg = joint("lower_leg" + end, upper_leg, {side * 0.05, 0, -0.3});
      const int foot = joint("foot" + end, lower_leg, {side * 0.05, 0, -0.5});
      const int toe = joint("toe" + end, foot, {side * 0.05, -0.09, -0.5});
      tube({side * 0.06, 0, 0.26}, {side * 0.5, 0, 0.26}, 0.04, 28, {upper_arm, lower_arm}, {0.24}, 0.04);
      tube({side * 0.05, 0, -0.06}, {side * 0.05, 0, -0.5}, 0.04, 28, {upper_leg, lower_leg}, {0.24}, 0.04);
      tube({side * 0.05, 0.02, -0.5}, {side * 0.05, -0.16, -0.5}, 0.03, 12, {foot, toe}, {0.11}, 0.03);
    }
    asset.name = "doll";
    asset.skeleton = skeleton_from_joints(positions_, parents_, names_);
  }

  Asset asset;

 private:
  static constexpr int kSections = 16;

  int joint(const std::string& name, int parent, const Eigen::Vector3d& position) {
    names_.push_back(name);
    parents_.push_back(parent);
    positions_.push_back(position);
    return static_cast<int>(names_.size()) - 1;
  }

  /// @param cuts lengths along the tube at which the next joint of the chain takes over, within ± half
  void tube(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius, int rings,
            const std::vector<int>& chain, const std::vector<double>& cuts, double half) {
    const double length = (to - from).norm();
    const Eigen::Vector3d along = (to - from) / length;
    const Eigen::Vector3d u = along.unitOrthogonal(), v = along.cross(u);
    const auto row = [&](double t) {
      std::vector<Influence> weights{{chain[0], 1.0f}};
      for (std::size_t k = 0; k < cuts.size(); ++k) {
        const double x = std::clamp((t - cuts[k] + half) / (2.0 * half), 0.0, 1.0), step = x * x * (3.0 - 2.0 * x);
        weights.back().weight *= static_cast<float>(1.0 - step);
        weights.push_back({chain[k + 1], static_cast<float>(step)});
      }
      return weights;
    };
    Mesh& mesh = asset.mesh;
    const auto first = static_cast<int>(mesh.vertices.size());
    const auto at_ring = [first](int ring, int section) { return first + ring * kSections + section % kSections; };
    for (int ring = 0; ring <= rings; ++ring) {
      const double t = length * ring / rings;
      for (int section = 0; section < kSections; ++section) {
        const double angle = 2.0 * kPi * section / kSections;
        const Eigen::Vector3d out = std::cos(angle) * u + std::sin(angle) * v;
        mesh.vertices.push_back((from + t * along + thickness_ * radius * out).cast<float>());
        asset.skin.append_row(row(t));
      }
    }
    for (int ring = 0; ring < rings; ++ring) {
      for (int s = 0; s < kSections; ++s) {
        mesh.faces.push_back({at_ring(ring, s), at_ring(ring, s + 1), at_ring(ring + 1, s + 1)});
        mesh.faces.push_back({at_ring(ring, s), at_ring(ring + 1, s + 1), at_ring(ring + 1, s)});
      }
    }
    for (const bool end : {false, true}) {
      const auto middle = static_cast<int>(mesh.vertices.size());
      mesh.vertices.push_back((end ? to : from).cast<float>());
      asset.skin.append_row(row(end ? length : 0.0));
      for (int s = 0; s < kSections; ++s) {
        const int a = at_ring(end ? rings : 0, s), b = at_ring(end ? rings : 0, s + 1);
        mesh.faces.push_back(end ? Triangle{a, b, middle} : Triangle{b, a, middle});
      }
    }
  }

  double thickness_;
  std::vector<std::string> names_;
  std::vector<int> parents_;
  std::vector<Eigen::Vector3d> positions_;
};

inline std::int32_t joint_named(const Asset& asset, const std::string& name) {
  const auto& names = asset.skeleton.names;
  return static_cast<std::int32_t>(std::find(names.begin(), names.end(), name) - names.begin());
}

/// Writes all rows anew, as they are, without the order and sums that append_row() takes care of.
/// @param change of the row of a vertex
inline void change_rows(Asset& asset, const std::function<void(std::size_t, std::vector<Influence>&)>& change) {
  SkinWeights changed;
  for (std::size_t v = 0; v < asset.skin.rows(); ++v) {
    std::vector<Influence> row(asset.skin.row(v), asset.skin.row(v) + asset.skin.row_size(v));
    change(v, row);
    changed.influences.insert(changed.influences.end(), row.begin(), row.end());
    changed.offsets.push_back(changed.influences.size());
  }
  asset.skin = std::move(changed);
}

/// Turns mesh and bind pose about the origin. The rest pose stays.
inline void turn(Asset& asset, const Eigen::Matrix3d& rotation) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = rotation;
  for (Eigen::Vector3f& vertex : asset.mesh.vertices) vertex = (rotation * vertex.cast<double>()).cast<float>();
  for (Eigen::Matrix4d& bind : asset.skeleton.bind) bind = matrix * bind;
}

/// Adds the mesh and the weights of another asset of the same skeleton.
inline void add_part(Asset& asset, const Asset& part) {
  const auto first = static_cast<std::int32_t>(asset.mesh.vertices.size());
  asset.mesh.vertices.insert(asset.mesh.vertices.end(), part.mesh.vertices.begin(), part.mesh.vertices.end());
  for (Triangle face : part.mesh.faces) {
    for (std::int32_t& corner : face) corner += first;
    asset.mesh.faces.push_back(face);
  }
  for (std::size_t v = 0; v < part.skin.rows(); ++v) asset.skin.append_copy(part.skin, v);
}

}  // namespace anigen::test
