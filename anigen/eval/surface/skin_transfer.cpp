#include "anigen/eval/surface/skin_transfer.h"

#include <string>

#include "anigen/core/error.h"
#include "anigen/eval/surface/matching_places.h"
#include "anigen/eval/surface/point_index.h"
#include "anigen/geometry/surface_point.h"

namespace anigen::eval {
namespace {

void check_rows(std::size_t rows, std::size_t vertices) {
  if (rows == vertices) return;
  throw InputError("", "skin", std::to_string(rows) + " rows of weights for " + std::to_string(vertices) + " vertices");
}

void check_point(const Eigen::Vector3d& point, std::size_t index) {
  if (!point.allFinite()) throw InputError("", "points[" + std::to_string(index) + "]", "the position is not finite");
}

}  // namespace

SkinWeights transfer_skin(const geometry::NearestSurface& surface, const std::vector<Triangle>& faces,
                          const SkinWeights& skin, const std::vector<Eigen::Vector3d>& points) {
  std::vector<geometry::SurfacePoint> places;
  places.reserve(points.size());
  std::int32_t guess = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    check_point(points[i], i);
    places.push_back(surface.query(points[i], guess).at);
    guess = places.back().face;
  }
  return geometry::interpolate_skin(skin, faces, places);
}

SkinWeights transfer_skin(const Mesh& mesh, const SkinWeights& skin, const std::vector<Eigen::Vector3d>& points) {
  check_rows(skin.rows(), mesh.vertices.size());
  return transfer_skin(geometry::NearestSurface(mesh), mesh.faces, skin, points);
}

SkinWeights transfer_skin_to_mesh(const Mesh& mesh, const SkinWeights& skin, const Mesh& to) {
  check_rows(skin.rows(), mesh.vertices.size());
  return geometry::interpolate_skin(skin, mesh.faces, matching_places(mesh, to));
}

SkinWeights transfer_skin_by_vertex(const std::vector<Eigen::Vector3d>& vertices, const SkinWeights& skin,
                                    const std::vector<Eigen::Vector3d>& points) {
  check_rows(skin.rows(), vertices.size());
  const PointIndex index(vertices);
  SkinWeights result;
  result.offsets.reserve(points.size() + 1);
  for (std::size_t i = 0; i < points.size(); ++i) {
    check_point(points[i], i);
    const std::size_t vertex = index.nearest(points[i]).index;
    const Influence* row = skin.row(vertex);
    result.influences.insert(result.influences.end(), row, row + skin.row_size(vertex));
    result.offsets.push_back(result.influences.size());
  }
  return result;
}

}  // namespace anigen::eval
