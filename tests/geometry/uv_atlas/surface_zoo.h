#pragma once
#include <cmath>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/core/numeric.h"

/// Small surfaces that tests can reason about; closed ones run counter-clockwise seen from outside, without seams.
namespace anigen::test {

/// Sphere around the origin with single vertices at the poles.
inline Mesh round_sphere(double radius, int rings, int segments) {
  Mesh mesh;
  mesh.vertices.emplace_back(0.0F, 0.0F, static_cast<float>(radius));
  for (int r = 1; r < rings; ++r) {
    for (int s = 0; s < segments; ++s) {
      const double polar = kPi * r / rings, around = 2.0 * kPi * s / segments;
      const Eigen::Vector3d p(std::sin(polar) * std::cos(around), std::sin(polar) * std::sin(around), std::cos(polar));
      mesh.vertices.push_back((radius * p).cast<float>());
    }
  }
  mesh.vertices.emplace_back(0.0F, 0.0F, static_cast<float>(-radius));
  const auto south = static_cast<std::int32_t>(mesh.vertices.size() - 1);
  const auto at = [&](int r, int s) { return static_cast<std::int32_t>(1 + (r - 1) * segments + s % segments); };
  for (int s = 0; s < segments; ++s) {
    mesh.faces.push_back({0, at(1, s), at(1, s + 1)});
    for (int r = 1; r + 1 < rings; ++r) {
      mesh.faces.push_back({at(r, s), at(r + 1, s), at(r + 1, s + 1)});
      mesh.faces.push_back({at(r, s), at(r + 1, s + 1), at(r, s + 1)});
    }
    mesh.faces.push_back({at(rings - 1, s), south, at(rings - 1, s + 1)});
  }
  return mesh;
}

/// Torus around the z axis.
inline Mesh torus(double radius, double tube, int rings, int segments) {
  Mesh mesh;
  for (int r = 0; r < rings; ++r) {
    for (int s = 0; s < segments; ++s) {
      const double u = 2.0 * kPi * r / rings, v = 2.0 * kPi * s / segments, out = radius + tube * std::cos(v);
      const Eigen::Vector3d p(out * std::cos(u), out * std::sin(u), tube * std::sin(v));
      mesh.vertices.push_back(p.cast<float>());
    }
  }
  const auto at = [&](int r, int s) { return static_cast<std::int32_t>((r % rings) * segments + s % segments); };
  for (int r = 0; r < rings; ++r) {
    for (int s = 0; s < segments; ++s) {
      mesh.faces.push_back({at(r, s), at(r + 1, s), at(r + 1, s + 1)});
      mesh.faces.push_back({at(r, s), at(r + 1, s + 1), at(r, s + 1)});
    }
  }
  return mesh;
}

/// [-0.5, 0.5]³ with eight vertices.
inline Mesh unit_cube() {
  Mesh mesh;
  for (int i = 0; i < 8; ++i)
    mesh.vertices.emplace_back(i & 1 ? 0.5F : -0.5F, i & 2 ? 0.5F : -0.5F, i & 4 ? 0.5F : -0.5F);
  mesh.faces = {{1, 3, 7}, {1, 7, 5}, {2, 0, 4}, {2, 4, 6}, {3, 2, 6}, {3, 6, 7},
                {0, 1, 5}, {0, 5, 4}, {4, 5, 7}, {4, 7, 6}, {2, 3, 1}, {2, 1, 0}};
  return mesh;
}

/// A ramp that winds around the z axis between two radii, facing up; seen from above it covers itself `turns` times.
inline Mesh spiral_ramp(int turns, int steps_per_turn) {
  Mesh mesh;
  for (int i = 0; i <= turns * steps_per_turn; ++i) {
    const double angle = 2.0 * kPi * i / steps_per_turn, height = 0.1 * i / steps_per_turn;
    for (const double radius : {0.2, 0.5}) {
      mesh.vertices.push_back(
          Eigen::Vector3d(radius * std::cos(angle), radius * std::sin(angle), height).cast<float>());
    }
  }
  for (std::int32_t i = 0; i < turns * steps_per_turn; ++i) {
    mesh.faces.push_back({2 * i, 2 * i + 1, 2 * i + 3});
    mesh.faces.push_back({2 * i, 2 * i + 3, 2 * i + 2});
  }
  return mesh;
}

/// Copy of a surface with three vertices of its own for every face.
inline Mesh unwelded(const Mesh& mesh) {
  Mesh apart;
  for (const Triangle& face : mesh.faces) {
    const auto first = static_cast<std::int32_t>(apart.vertices.size());
    for (const std::int32_t corner : face) apart.vertices.push_back(mesh.vertices[at(corner)]);
    apart.faces.push_back({first, first + 1, first + 2});
  }
  return apart;
}

}  // namespace anigen::test
