#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/core/numeric.h"

namespace anigen::test {

struct Capsule {
  Eigen::Vector3d a, b;
  double radius;
};

/// Closed capsules side by side, where they overlap with their surfaces inside each other.
inline Mesh capsule_mesh(const std::vector<Capsule>& capsules, int segments = 16, int rings = 5) {
  Mesh mesh;
  for (const Capsule& capsule : capsules) {
    const Eigen::Vector3d along = capsule.b - capsule.a;
    const Eigen::Vector3d axis = along.norm() > 0.0 ? Eigen::Vector3d(along.normalized()) : Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d u = axis.unitOrthogonal(), v = axis.cross(u);
    const auto first = static_cast<std::int32_t>(mesh.vertices.size());
    const auto add = [&](const Eigen::Vector3d& p) { mesh.vertices.push_back(p.cast<float>()); };
    add(capsule.a - capsule.radius * axis);
    for (int half = 0; half < 2; ++half) {
      for (int i = 0; i < rings; ++i) {
        const double angle = kPi / 2.0 * (half == 0 ? (i + 1.0) / rings - 1.0 : static_cast<double>(i) / rings);
        for (int s = 0; s < segments; ++s) {
          const double turn = 2.0 * kPi * s / segments;
          const Eigen::Vector3d around = std::cos(turn) * u + std::sin(turn) * v;
          add((half == 0 ? capsule.a : capsule.b) +
              capsule.radius * (std::sin(angle) * axis + std::cos(angle) * around));
        }
      }
    }
    add(capsule.b + capsule.radius * axis);
    const std::int32_t last = static_cast<std::int32_t>(mesh.vertices.size()) - 1;
    for (std::int32_t s = 0; s < segments; ++s) {
      const std::int32_t next = (s + 1) % segments;
      mesh.faces.push_back({first, first + 1 + next, first + 1 + s});
      for (std::int32_t r = 0; r + 1 < 2 * rings; ++r) {
        const std::int32_t low = first + 1 + r * segments, high = low + segments;
        mesh.faces.push_back({low + s, low + next, high + next});
        mesh.faces.push_back({low + s, high + next, high + s});
      }
      const std::int32_t top = last - segments;
      mesh.faces.push_back({top + s, top + next, last});
    }
  }
  return mesh;
}

/// Mirrored onto the other side, after every capsule that is not in the middle.
inline std::vector<Capsule> with_mirrored(std::vector<Capsule> capsules) {
  std::vector<Capsule> all;
  const auto mirrored = [](const Eigen::Vector3d& p) { return Eigen::Vector3d(-p.x(), p.y(), p.z()); };
  for (const Capsule& capsule : capsules) {
    all.push_back(capsule);
    if (capsule.a.x() == 0.0 && capsule.b.x() == 0.0) continue;
    all.push_back({mirrored(capsule.a), mirrored(capsule.b), capsule.radius});
  }
  return all;
}

/// A person of height 1, arms out.
inline std::vector<Capsule> person() {
  return with_mirrored({{{0, 0, 0.03}, {0, 0, 0.24}, 0.09},
                        {{0, 0, 0.25}, {0, 0, 0.36}, 0.04},
                        {{0, 0, 0.42}, {0, 0, 0.42}, 0.08},
                        {{0, 0, 0.27}, {0.26, 0, 0.28}, 0.04},
                        {{0.26, 0, 0.28}, {0.46, 0, 0.28}, 0.03},
                        {{0.055, 0, 0.02}, {0.07, 0, -0.22}, 0.05},
                        {{0.07, 0, -0.22}, {0.07, 0, -0.46}, 0.04},
                        {{0.07, 0.01, -0.465}, {0.07, -0.08, -0.47}, 0.03}});
}

/// Positions of the person's joints, of the left side.
inline std::map<std::string, Eigen::Vector3d> person_joints() {
  return {{"hips", {0, 0, 0.03}},
          {"chest", {0, 0, 0.25}},
          {"head", {0, 0, 0.37}},
          {"left_upper_arm", {0.11, 0, 0.27}},
          {"left_lower_arm", {0.26, 0, 0.28}},
          {"left_hand", {0.40, 0, 0.28}},
          {"left_upper_leg", {0.055, 0, 0}},
          {"left_lower_leg", {0.07, 0, -0.22}},
          {"left_foot", {0.07, 0, -0.44}}};
}

/// An animal of length 1 on four legs.
inline std::vector<Capsule> animal() {
  return with_mirrored({{{0, 0.2, 0.08}, {0, -0.15, 0.08}, 0.09},
                        {{0, -0.18, 0.1}, {0, -0.33, 0.26}, 0.05},
                        {{0, -0.34, 0.27}, {0, -0.43, 0.25}, 0.06},
                        {{0, 0.25, 0.1}, {0, 0.47, 0.02}, 0.02},
                        {{0.065, -0.16, 0.05}, {0.075, -0.14, -0.14}, 0.04},
                        {{0.075, -0.14, -0.14}, {0.075, -0.15, -0.38}, 0.03},
                        {{0.065, 0.2, 0.05}, {0.075, 0.18, -0.14}, 0.045},
                        {{0.075, 0.18, -0.14}, {0.075, 0.22, -0.38}, 0.03}});
}

inline std::map<std::string, Eigen::Vector3d> animal_joints() {
  return {{"hips", {0, 0.21, 0.08}},
          {"chest", {0, -0.14, 0.08}},
          {"head", {0, -0.33, 0.26}},
          {"tail_1", {0, 0.36, 0.06}},
          {"left_front_lower_leg", {0.075, -0.14, -0.12}},
          {"left_front_toes", {0.075, -0.15, -0.36}},
          {"left_hind_lower_leg", {0.075, 0.18, -0.12}},
          {"left_hind_toes", {0.075, 0.22, -0.36}}};
}

}  // namespace anigen::test
