#pragma once
#include <cstdint>
#include <vector>

#include "anigen/geometry/uv_atlas/surface_charts.h"

namespace anigen::geometry {

/// Whether a face may be projected along the axis: it turns from it by at most the limit, or has no area.
inline bool face_fits(const SurfaceFaces& surface, std::int32_t face, const Eigen::Vector3d& axis,
                      double least_cosine) {
  const auto f = static_cast<std::size_t>(face);
  return surface.areas[f] <= 0.0 || surface.normals[f].dot(axis) >= least_cosine;
}

/// The first steps of surface_charts(): faces grouped by growing.
/// @param least_cosine of the angle between a face's normal and the mean normal of its group
/// @return groups of faces; each connected, none empty, all within the limit, together every face once
std::vector<std::vector<std::int32_t>> grow_charts(const SurfaceFaces& surface, const FaceAdjacency& adjacency,
                                                   double least_cosine);

/// The last step: in order of area, every group joins the neighbour that it shares the longest border with among those
/// that it can join within the limit.
std::vector<std::vector<std::int32_t>> merge_charts(const SurfaceFaces& surface, const FaceAdjacency& adjacency,
                                                    double least_cosine, std::vector<std::vector<std::int32_t>> groups);

}  // namespace anigen::geometry
