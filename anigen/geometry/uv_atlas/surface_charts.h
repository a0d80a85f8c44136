#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/uv_atlas/face_adjacency.h"

namespace anigen::geometry {

/// What charts are made of, per face, in double precision.
struct SurfaceFaces {
  SurfaceFaces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);

  std::size_t size() const { return areas.size(); }

  std::vector<Eigen::Vector3d> normals;    ///< unit length; zero for a face without area
  std::vector<Eigen::Vector3d> centroids;  ///< means of the corners
  std::vector<double> areas;
};

/// A connected patch of a surface that is projected along one axis.
struct SurfaceChart {
  std::vector<std::int32_t> faces;  ///< ascending
  Eigen::Vector3d axis;             ///< unit length, towards the outside
};

/// Area-weighted mean normal of some faces, unit length; of all unit vectors the one nearest to their normals in the
/// least-squares sense. The zero vector where they cancel or have no area.
Eigen::Vector3d mean_normal(const SurfaceFaces& surface, const std::vector<std::int32_t>& faces);

/// Divides a surface into charts none of whose faces turns from its chart's axis by more than max_deviation; faces
/// without area go with a neighbour. First charts grow one after another from the largest face that is left, then all
/// grow again at once from their middles (the relaxation of variational shape approximation, Cohen-Steiner et al. 2004,
/// section 3, with normals as proxies), and at last small ones join neighbours where the limit allows. Every face is in
/// exactly one chart. Deterministic.
/// @param max_deviation radians, in (0, π/2)
std::vector<SurfaceChart> surface_charts(const SurfaceFaces& surface, const FaceAdjacency& adjacency,
                                         double max_deviation);

}  // namespace anigen::geometry
