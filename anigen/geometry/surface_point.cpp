#include "anigen/geometry/surface_point.h"

#include <string>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::geometry {

Eigen::Vector3d position(const SurfacePoint& point, const std::vector<Eigen::Vector3f>& vertices,
                         const std::vector<Triangle>& faces) {
  const Triangle& face = faces[static_cast<std::size_t>(point.face)];
  Eigen::Vector3d result = Eigen::Vector3d::Zero();
  for (int k = 0; k < 3; ++k) {
    result +=
        point.barycentric[k] * vertices[static_cast<std::size_t>(face[static_cast<std::size_t>(k)])].cast<double>();
  }
  return result;
}

SkinWeights interpolate_skin(const SkinWeights& weights, const std::vector<Triangle>& faces,
                             const std::vector<SurfacePoint>& points) {
  SkinWeights result;
  result.offsets.reserve(points.size() + 1);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const SurfacePoint& point = points[i];
    if (point.face < 0 || static_cast<std::size_t>(point.face) >= faces.size()) {
      throw InputError("", "points[" + std::to_string(i) + "]", "there is no face " + std::to_string(point.face));
    }
    std::vector<Influence> row;
    for (int k = 0; k < 3; ++k) {
      const auto vertex =
          static_cast<std::size_t>(faces[static_cast<std::size_t>(point.face)][static_cast<std::size_t>(k)]);
      if (vertex >= weights.rows()) {
        throw InputError("", "faces[" + std::to_string(point.face) + "]",
                         "vertex " + std::to_string(vertex) + " has no skin weights; there are " +
                             std::to_string(weights.rows()) + " rows");
      }
      for (std::size_t n = 0; n < weights.row_size(vertex); ++n) {
        const Influence& influence = weights.row(vertex)[n];
        row.push_back({influence.joint, static_cast<float>(point.barycentric[k] * influence.weight)});
      }
    }
    if (!result.append_row(std::move(row))) {
      // append_row left an empty row behind; fill it in place.
      result.influences.push_back({0, 1.0f});
      result.offsets.back() = result.influences.size();
    }
  }
  return result;
}

}  // namespace anigen::geometry
