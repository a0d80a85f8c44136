#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"

namespace anigen::geometry {

/// A place on a triangle mesh: a face and barycentric weights of its three corners (≥ 0, sum 1).
struct SurfacePoint {
  std::int32_t face = -1;
  Eigen::Vector3d barycentric = Eigen::Vector3d::Zero();
};

Eigen::Vector3d position(const SurfacePoint& point, const std::vector<Eigen::Vector3f>& vertices,
                         const std::vector<Triangle>& faces);

/// Skin weights at places on the surface: Σ_corner barycentric · row(corner), one row per point. A row without any
/// positive weight becomes weight 1 on joint 0, as from_dense does.
/// @param weights one row per vertex @throws InputError when a face refers to a missing row
SkinWeights interpolate_skin(const SkinWeights& weights, const std::vector<Triangle>& faces,
                             const std::vector<SurfacePoint>& points);

}  // namespace anigen::geometry
