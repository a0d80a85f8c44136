#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {

/// Pairs of faces of a surface that share an edge. Vertices at exactly the same position count as one, so that a mesh
/// split along texture seams or hard edges is still connected there.
class FaceAdjacency {
 public:
  struct Link {
    std::int32_t face;  ///< on the other side of the edge
    double length;      ///< of the edge
  };
  struct Links {
    const Link* first;
    const Link* last;
    const Link* begin() const { return first; }
    const Link* end() const { return last; }
  };

  /// @param faces valid indices
  FaceAdjacency(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);

  /// Neighbours across every edge of the face, by face number; a face that shares two edges comes twice. Edges with
  /// more than two faces link all of them, or, beyond a handful, each to the next one only.
  Links of(std::int32_t face) const;

  /// The parts of a set of faces that hang together by edges within it, each ascending, ordered by first face.
  std::vector<std::vector<std::int32_t>> connected_pieces(std::vector<std::int32_t> faces) const;

 private:
  std::vector<std::size_t> offsets_;  ///< [F + 1]
  std::vector<Link> links_;
};

/// Data of charts, per face, in double precision.
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

/// True when a face may be projected along the axis: it turns from it by at most the limit, or has no area.
inline bool face_fits(const SurfaceFaces& surface, std::int32_t face, const Eigen::Vector3d& axis,
                      double least_cosine) {
  const auto f = static_cast<std::size_t>(face);
  return surface.areas[f] <= 0.0 || surface.normals[f].dot(axis) >= least_cosine;
}

/// The last step: in order of area, every group joins the neighbour that it shares the longest border with among those
/// that it can join within the limit.
std::vector<std::vector<std::int32_t>> merge_charts(const SurfaceFaces& surface, const FaceAdjacency& adjacency,
                                                    double least_cosine, std::vector<std::vector<std::int32_t>> groups);

/// A chart laid out flat, in the unit of the mesh: projected along its axis, turned so that its box is the smallest of
/// all rectangles around it and lies on its longer side, the box' lower left corner at the origin. Seen from outside,
/// not mirrored: triangles run counter-clockwise.
struct PlanarChart {
  SurfaceChart chart;
  std::vector<std::int32_t> vertices;   ///< of the mesh, one per point
  std::vector<Eigen::Vector2d> points;  ///< in [0, extent]
  std::vector<Triangle> triangles;      ///< into points, in the order of chart.faces
  Eigen::Vector3d right, up;            ///< unit vectors of the plane in the mesh's frame
  Eigen::Vector2d extent;               ///< width ≥ height
  double area = 0.0;                    ///< of the triangles
};

PlanarChart planar_chart(SurfaceChart chart, const std::vector<Eigen::Vector3f>& vertices,
                         const std::vector<Triangle>& faces);

}  // namespace anigen::geometry
