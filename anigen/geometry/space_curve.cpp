#include "anigen/geometry/space_curve.h"

#include <algorithm>
#include <cmath>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {
namespace {

constexpr double kLastCell = 1023.0;

/// Spreads the lowest 10 bits to every third place.
std::uint32_t every_third(std::uint32_t bits) {
  bits = (bits | bits << 16) & 0x030000FFu;
  bits = (bits | bits << 8) & 0x0300F00Fu;
  bits = (bits | bits << 4) & 0x030C30C3u;
  return (bits | bits << 2) & 0x09249249u;
}

}  // namespace

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
