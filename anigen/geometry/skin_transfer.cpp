#include "anigen/geometry/skin_transfer.h"

#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/surface_point.h"

namespace anigen::geometry {
namespace {

void check_length(std::size_t length, std::size_t vertices, const char* what) {
  if (length == 0 || length == vertices) return;
  throw InputError("", what, std::to_string(length) + " entries for " + std::to_string(vertices) + " vertices");
}

}  // namespace

TransferredAttributes transfer_attributes(const Mesh& from, const SkinWeights& skin,
                                          const std::vector<Eigen::Vector3f>& points) {
  check_length(skin.rows(), from.vertices.size(), "skin");
  check_length(from.colors.size(), from.vertices.size(), "colors");
  std::vector<SurfacePoint> places;
  places.reserve(points.size());
  for (const NearestPoint& nearest : NearestSurface(from).query(points)) places.push_back(nearest.at);
  TransferredAttributes result;
  if (skin.rows() > 0) result.skin = interpolate_skin(skin, from.faces, places);
  if (from.colors.empty()) return result;
  for (const SurfacePoint& place : places) {
    const Triangle& face = from.faces[at(place.face)];
    Eigen::Vector4d color = Eigen::Vector4d::Zero();
    for (int k = 0; k < 3; ++k) color += place.barycentric[k] * from.colors[at(face[at(k)])].cast<double>();
    result.colors.push_back(color.cast<float>());
  }
  return result;
}

}  // namespace anigen::geometry
