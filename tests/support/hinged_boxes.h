#pragma once
#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "anigen/asset/rigged_asset.h"

namespace anigen::test {

/// Adds a box as files with hard edges have it: six faces of four vertices each, none shared.
inline void add_flat_box(Mesh& mesh, const Eigen::Vector3f& low, const Eigen::Vector3f& high) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const bool upper : {false, true}) {
      const auto first = static_cast<std::int32_t>(mesh.vertices.size());
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      for (int corner = 0; corner < 4; ++corner) {
        Eigen::Vector3f place = low;
        place[axis] = upper ? high[axis] : low[axis];
        if (corner == 1 || corner == 2) place[u] = high[u];
        if (corner >= 2) place[v] = high[v];
        mesh.vertices.push_back(place);
      }
      const std::int32_t a = upper ? 1 : 3, b = upper ? 3 : 1;
      mesh.faces.push_back({first, first + a, first + 2});
      mesh.faces.push_back({first, first + 2, first + b});
    }
  }
}

/// Two boxes of 1 × 1 × 1 beside each other along X, a gap apart, and two joints: the root in the middle of the first
/// box, the hinge at `hinge`, in the middle of the gap by default. The weights bleed: a vertex of either box has a
/// share of the other box's joint that grows towards the gap, up to `bleed`.
inline Asset hinged_boxes(float gap, float bleed, const Eigen::Vector3d* hinge = nullptr) {
  Asset asset;
  asset.name = "hinge";
  add_flat_box(asset.mesh, {-1.0F - gap / 2, -0.5F, -0.5F}, {-gap / 2, 0.5F, 0.5F});
  const std::size_t first = asset.mesh.vertices.size();
  add_flat_box(asset.mesh, {gap / 2, -0.5F, -0.5F}, {1.0F + gap / 2, 0.5F, 0.5F});
  asset.skeleton = skeleton_from_joints({{-0.5, 0, 0}, hinge != nullptr ? *hinge : Eigen::Vector3d::Zero(), {1, 0, 0}},
                                        {-1, 0, 1}, {"base", "lid", "end"});
  for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) {
    const bool near = std::abs(asset.mesh.vertices[v].x()) < 0.5F;
    const float other = near ? bleed : 0.0F;
    asset.skin.append_row({{v < first ? 0 : 1, 1.0F - other}, {v < first ? 1 : 0, other}});
  }
  return asset;
}

}  // namespace anigen::test
