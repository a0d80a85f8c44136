#pragma once
#include <cmath>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/core/random.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/metrics/icp.h"
#include "anigen/metrics/similarity.h"

/// Shapes whose alignment is known.
namespace anigen::test {

/// Adds an ellipsoid, turned about the X axis by `tilt` radians.
inline void add_ellipsoid(Mesh& mesh, const Eigen::Vector3d& center, const Eigen::Vector3d& radii, double tilt,
                          int rings) {
  constexpr double kPi = 3.14159265358979;
  const int segments = 2 * rings;
  const auto first = static_cast<std::int32_t>(mesh.vertices.size());
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(tilt, Eigen::Vector3d::UnitX()).toRotationMatrix();
  for (int r = 0; r <= rings; ++r) {
    for (int s = 0; s < segments; ++s) {
      const double polar = kPi * r / rings, around = 2 * kPi * s / segments;
      const Eigen::Vector3d unit(std::sin(polar) * std::cos(around), std::sin(polar) * std::sin(around),
                                 std::cos(polar));
      mesh.vertices.push_back((center + turn * radii.cwiseProduct(unit)).cast<float>());
    }
  }
  const auto at = [&](int r, int s) { return first + r * segments + s % segments; };
  for (int r = 0; r < rings; ++r) {
    for (int s = 0; s < segments; ++s) {
      if (r > 0) mesh.faces.push_back({at(r, s), at(r + 1, s), at(r, s + 1)});
      if (r + 1 < rings) mesh.faces.push_back({at(r, s + 1), at(r + 1, s), at(r + 1, s + 1)});
    }
  }
}

/// A walking figure facing -Y, nearly mirror symmetric and nearly the same from behind: one arm raised forward, one leg
/// ahead, a nose. @param rings tessellation of every limb
inline Mesh walker(int rings = 12) {
  Mesh mesh;
  add_ellipsoid(mesh, {0, 0, 0.1}, {0.16, 0.1, 0.28}, 0, rings);
  add_ellipsoid(mesh, {0, -0.02, 0.5}, {0.09, 0.1, 0.11}, 0, rings);
  add_ellipsoid(mesh, {0, -0.14, 0.48}, {0.02, 0.05, 0.02}, 0, rings);
  add_ellipsoid(mesh, {-0.24, -0.12, 0.22}, {0.05, 0.05, 0.2}, 1.1, rings);
  add_ellipsoid(mesh, {0.24, 0.03, 0.1}, {0.05, 0.05, 0.2}, -0.2, rings);
  add_ellipsoid(mesh, {-0.09, 0.05, -0.34}, {0.06, 0.06, 0.26}, -0.25, rings);
  add_ellipsoid(mesh, {0.09, -0.08, -0.34}, {0.06, 0.06, 0.26}, 0.3, rings);
  return mesh;
}

/// Something four-legged and flat, with a tail to one side.
inline Mesh crawler(int rings = 12) {
  Mesh mesh;
  add_ellipsoid(mesh, {0, 0, 0}, {0.15, 0.4, 0.1}, 0, rings);
  add_ellipsoid(mesh, {0, -0.45, 0.12}, {0.08, 0.14, 0.08}, 0, rings);
  for (const double x : {-0.16, 0.16}) {
    for (const double y : {-0.25, 0.27}) add_ellipsoid(mesh, {x, y, -0.15}, {0.04, 0.04, 0.16}, 0, rings);
  }
  add_ellipsoid(mesh, {0.08, 0.5, 0.1}, {0.03, 0.2, 0.03}, 0.4, rings);
  return mesh;
}

inline std::vector<Eigen::Vector3d> random_points(std::size_t count, std::uint64_t seed) {
  Rng rng(seed, "test points");
  std::vector<Eigen::Vector3d> points;
  for (std::size_t i = 0; i < count; ++i)
    points.emplace_back(rng.uniform(-1, 1), rng.uniform(-0.6, 0.6), rng.uniform(-0.3, 0.3));
  return points;
}

inline metrics::Similarity random_similarity(std::uint64_t seed, bool with_scale = true) {
  Rng rng(seed, "test similarity");
  metrics::Similarity result;
  result.rotation = metrics::random_rotation(rng);
  if (with_scale) result.scale = std::exp(rng.uniform(-1.5, 1.5));
  result.translation = {rng.uniform(-3, 3), rng.uniform(-3, 3), rng.uniform(-3, 3)};
  return result;
}

/// With two joints, so that it has a skeleton.
inline io::RiggedShape rigged(Mesh mesh) {
  io::RiggedShape shape;
  shape.file = "shape.glb";
  shape.joints = {{{0, 0, 0}, {0, 0, 0.4}, {0.2, 0, 0.3}}, {-1, 0, 1}};
  shape.mesh = std::move(mesh);
  return shape;
}

/// The farthest that any vertex of `moved`, placed, lies from the same vertex of `original`, placed.
inline double largest_offset(const metrics::Similarity& moved_placement, const Mesh& moved,
                             const metrics::Similarity& original_placement, const Mesh& original) {
  double largest = 0.0;
  for (std::size_t v = 0; v < original.vertices.size(); ++v) {
    largest = std::max(largest, (moved_placement(moved.vertices[v].cast<double>()) -
                                 original_placement(original.vertices[v].cast<double>()))
                                    .norm());
  }
  return largest;
}

}  // namespace anigen::test
