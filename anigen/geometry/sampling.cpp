#include "anigen/geometry/sampling.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::geometry {

namespace {

void check_indices(std::size_t vertices, const std::vector<Triangle>& faces) {
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (const std::int32_t index : faces[f]) {
      if (index < 0 || static_cast<std::size_t>(index) >= vertices) {
        throw InputError(
            "", "mesh.faces[" + std::to_string(f) + "]",
            "vertex index " + std::to_string(index) + " is outside the " + std::to_string(vertices) + " vertices");
      }
    }
  }
}

constexpr double kLastCell = 1023.0;

/// Spreads the lowest 10 bits to every third place.
std::uint32_t every_third(std::uint32_t bits) {
  bits = (bits | bits << 16) & 0x030000FFu;
  bits = (bits | bits << 8) & 0x0300F00Fu;
  bits = (bits | bits << 4) & 0x030C30C3u;
  return (bits | bits << 2) & 0x09249249u;
}

}  // namespace

std::vector<double> face_probabilities(const std::vector<Eigen::Vector3f>& vertices,
                                       const std::vector<Triangle>& faces) {
  check_indices(vertices.size(), faces);
  std::vector<double> result(faces.size());
  double sum = 0.0;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const double area = 0.5 * area_vector(vertices, faces[f]).norm();
    if (!std::isfinite(area)) {
      std::fill(result.begin(), result.end(), 1.0 / static_cast<double>(faces.size()));
      return result;
    }
    result[f] = std::max(area, 1e-12);
    sum += result[f];
  }
  for (double& value : result) value /= sum;
  return result;
}

std::vector<SurfacePoint> sample_surface(const std::vector<Eigen::Vector3f>& vertices,
                                         const std::vector<Triangle>& faces, std::size_t count, Rng& rng) {
  if (count == 0) return {};
  if (faces.empty()) throw InputError("", "mesh.faces", "a mesh without faces has no surface to sample");
  std::vector<double> cumulative = face_probabilities(vertices, faces);
  for (std::size_t f = 1; f < cumulative.size(); ++f) cumulative[f] += cumulative[f - 1];
  std::vector<SurfacePoint> points(count);
  for (SurfacePoint& point : points) {
    // Scaling by the last sum keeps the draw below it despite rounding.
    const double draw = rng.uniform() * cumulative.back();
    const auto found = std::upper_bound(cumulative.begin(), cumulative.end(), draw);
    const auto last = static_cast<std::ptrdiff_t>(cumulative.size()) - 1;
    point.face = static_cast<std::int32_t>(std::min(found - cumulative.begin(), last));
    const double root = std::sqrt(rng.uniform()), v = rng.uniform();
    point.barycentric = {1.0 - root, root * (1.0 - v), root * v};
  }
  return points;
}

std::vector<std::uint32_t> along_curve(const std::vector<Eigen::Vector3d>& points) {
  Box box;
  for (const Eigen::Vector3d& point : points) box.extend(point);
  const double side = box.longest_side(), scale = side > 0.0 ? kLastCell / side : 0.0;
  std::vector<std::uint64_t> keys(points.size());  // the place on the curve above, the index below
  for (std::size_t i = 0; i < points.size(); ++i) {
    std::uint32_t code = 0;
    for (int k = 0; k < 3; ++k) {
      const double cell = scale * (points[i][k] - box.low[k]);
      // Sides too long or too short to divide by put everything into one cell.
      const double inside = std::isfinite(cell) ? std::clamp(cell, 0.0, kLastCell) : 0.0;
      code |= every_third(static_cast<std::uint32_t>(inside)) << k;
    }
    keys[i] = std::uint64_t{code} << 32 | static_cast<std::uint32_t>(i);
  }
  std::sort(keys.begin(), keys.end());
  std::vector<std::uint32_t> order;
  order.reserve(keys.size());
  for (const std::uint64_t key : keys) order.push_back(static_cast<std::uint32_t>(key));
  return order;
}

}  // namespace anigen::geometry
