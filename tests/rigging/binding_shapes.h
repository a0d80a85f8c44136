#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/core/numeric.h"
#include "anigen/rigging/binding.h"

/// Bodies to bind, and what every binding must be.
namespace anigen::test {

/// A tube around the x axis with round ends, from −length to length; rings of vertices at the same x are mirror images.
inline Mesh capsule(double length, double radius, int rings, int sections) {
  Mesh mesh;
  const auto add = [&](double x, double y, double z) {
    mesh.vertices.emplace_back(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z));
  };
  const auto radius_at = [&](double x) {
    const double cap = std::max(0.0, std::abs(x) - (length - radius));
    return std::sqrt(std::max(0.0, radius * radius - cap * cap));
  };
  add(-length, 0.0, 0.0);
  for (int r = 1; r < rings; ++r) {
    const double x = length * (2.0 * r - rings) / rings;
    for (int s = 0; s < sections; ++s) {
      const double angle = 2.0 * kPi * (s + 0.5) / sections;
      add(x, radius_at(x) * std::cos(angle), radius_at(x) * std::sin(angle));
    }
  }
  add(length, 0.0, 0.0);
  const auto last = static_cast<std::int32_t>(mesh.vertices.size() - 1);
  const auto ring = [&](int r, int s) { return static_cast<std::int32_t>(1 + (r - 1) * sections + s % sections); };
  for (int s = 0; s < sections; ++s) {
    mesh.faces.push_back({0, ring(1, s + 1), ring(1, s)});
    for (int r = 1; r + 1 < rings; ++r) {
      mesh.faces.push_back({ring(r, s), ring(r, s + 1), ring(r + 1, s)});
      mesh.faces.push_back({ring(r + 1, s), ring(r, s + 1), ring(r + 1, s + 1)});
    }
    mesh.faces.push_back({ring(rings - 1, s), ring(rings - 1, s + 1), last});
  }
  return mesh;
}

/// A closed box whose six sides are grids of n² squares, each side with vertices of its own: seams all around.
inline void append_box(Mesh& mesh, const Eigen::Vector3d& low, const Eigen::Vector3d& high, int n) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const bool upper : {false, true}) {
      const auto base = static_cast<std::int32_t>(mesh.vertices.size());
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      for (int i = 0; i <= n; ++i) {
        for (int j = 0; j <= n; ++j) {
          Eigen::Vector3d p = upper ? high : low;
          p[u] = low[u] + (high[u] - low[u]) * i / n;
          p[v] = low[v] + (high[v] - low[v]) * j / n;
          mesh.vertices.push_back(p.cast<float>());
        }
      }
      for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) {
          const std::int32_t a = base + i * (n + 1) + j, b = a + n + 1, c = b + 1, d = a + 1;
          mesh.faces.push_back(upper ? Triangle{a, b, c} : Triangle{a, c, b});
          mesh.faces.push_back(upper ? Triangle{a, c, d} : Triangle{a, d, c});
        }
      }
    }
  }
}

struct Body {
  Mesh mesh;
  Skeleton skeleton;
};

/// A palm with a thick and a thin finger along x, a gap of 0.05 between them. The side of the thick one is nearer to
/// the bone of the thin one (joint 3 and its tip 4) than to its own (1 and 2).
inline Body two_fingers() {
  Body body;
  append_box(body.mesh, {0.0, 0.0, 0.0}, {1.0, 0.6, 0.3}, 8);
  append_box(body.mesh, {0.95, 0.0, 0.02}, {2.2, 0.4, 0.28}, 10);
  append_box(body.mesh, {0.95, 0.45, 0.1}, {2.2, 0.55, 0.2}, 10);
  body.skeleton = skeleton_from_joints(
      {{0.2, 0.3, 0.15}, {1.0, 0.2, 0.15}, {2.1, 0.2, 0.15}, {1.0, 0.5, 0.15}, {2.1, 0.5, 0.15}}, {-1, 0, 1, 0, 3});
  return body;
}

/// A capsule along x with joints at −0.9, 0 and 0.9: two bones that meet in the middle, and a tip.
inline Body two_bones() {
  return {capsule(1.2, 0.2, 48, 16), skeleton_from_joints({{-0.9, 0, 0}, {0, 0, 0}, {0.9, 0, 0}}, {-1, 0, 1})};
}

inline const std::vector<rigging::SkinBinding> kAllBindings = {
    rigging::SkinBinding::kNearest, rigging::SkinBinding::kGeodesicVoxels, rigging::SkinBinding::kHeat};

/// Coarser voxels than the default, for time.
inline rigging::BindingOptions coarse(int resolution = 64) {
  rigging::BindingOptions options;
  options.geodesic.resolution = resolution;
  return options;
}

inline SkinWeights bound(rigging::SkinBinding binding, const Body& body,
                         const rigging::BindingOptions& options = coarse()) {
  return rigging::bind(binding, body.mesh, body.skeleton, options);
}

inline float weight_of(const SkinWeights& skin, std::size_t vertex, int joint) {
  for (std::size_t i = 0; i < skin.row_size(vertex); ++i) {
    if (skin.row(vertex)[i].joint == joint) return skin.row(vertex)[i].weight;
  }
  return 0.0F;
}

/// One row per vertex with 1 to `most` known joints, heaviest first, none twice, finite weights that sum to 1.
inline void expect_sound(const SkinWeights& skin, const Body& body, std::size_t most = 4) {
  ASSERT_EQ(skin.rows(), body.mesh.vertices.size());
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    ASSERT_GE(skin.row_size(v), 1u) << "vertex " << v;
    ASSERT_LE(skin.row_size(v), most) << "vertex " << v;
    double sum = 0.0;
    for (std::size_t i = 0; i < skin.row_size(v); ++i) {
      const Influence& influence = skin.row(v)[i];
      ASSERT_TRUE(influence.joint >= 0 && at(influence.joint) < body.skeleton.size()) << "vertex " << v;
      ASSERT_GT(influence.weight, 0.0F) << "vertex " << v;
      if (i > 0) {
        ASSERT_LE(influence.weight, skin.row(v)[i - 1].weight) << "vertex " << v;
      }
      for (std::size_t k = 0; k < i; ++k) ASSERT_NE(skin.row(v)[k].joint, influence.joint) << "vertex " << v;
      sum += static_cast<double>(influence.weight);
    }
    ASSERT_NEAR(sum, 1.0, 1e-6) << "vertex " << v;
  }
}

/// Joints and bits are equal.
inline bool same_row(const SkinWeights& a, std::size_t v, const SkinWeights& b, std::size_t w) {
  if (a.row_size(v) != b.row_size(w)) return false;
  return std::equal(a.row(v), a.row(v) + a.row_size(v), b.row(w),
                    [](const Influence& x, const Influence& y) { return x.joint == y.joint && x.weight == y.weight; });
}

inline std::size_t differing_rows(const SkinWeights& a, const SkinWeights& b) {
  if (a.rows() != b.rows()) return std::max(a.rows(), b.rows());
  std::size_t count = 0;
  for (std::size_t v = 0; v < a.rows(); ++v) count += !same_row(a, v, b, v);
  return count;
}

/// Largest difference of any weight.
inline float largest_difference(const SkinWeights& a, const SkinWeights& b, std::size_t joints) {
  const std::vector<float> x = to_dense(a, joints), y = to_dense(b, joints);
  float largest = 0.0F;
  for (std::size_t i = 0; i < x.size(); ++i) largest = std::max(largest, std::abs(x[i] - y[i]));
  return largest;
}

}  // namespace anigen::test
