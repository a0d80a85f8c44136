#include "anigen/rig/binding/ray_parity.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "anigen/core/numeric.h"

namespace anigen::rig {
namespace {

using geometry::FixedPoint;
using geometry::Int128;

/// A triangle seen along `axis`: u and v are the other two.
struct SeenTriangle {
  std::array<const FixedPoint*, 3> corners;
  std::size_t axis, u, v;

  /// Does the edge cross the line through (pu, pv) along +u? Both ends in one order, so that two triangles agree about
  /// the edge they share; the upper end of an edge does not count, so that a line through a vertex counts once.
  bool crosses(const FixedPoint& a, const FixedPoint& b, std::int64_t pu, std::int64_t pv) const {
    if ((a[v] > pv) == (b[v] > pv)) return false;
    const FixedPoint &low = a[v] > pv ? b : a, &high = a[v] > pv ? a : b;
    return Int128{high[u] - low[u]} * (pv - low[v]) > Int128{pu - low[u]} * (high[v] - low[v]);
  }

  bool covers(std::int64_t pu, std::int64_t pv) const {
    bool inside = false;
    for (std::size_t k = 0; k < 3; ++k) inside ^= crosses(*corners[k], *corners[(k + 1) % 3], pu, pv);
    return inside;
  }

  /// Position along the axis over a covered point.
  double depth(std::int64_t pu, std::int64_t pv) const {
    const FixedPoint &a = *corners[0], &b = *corners[1], &c = *corners[2];
    const auto area = [&](std::int64_t bu, std::int64_t bv, std::int64_t cu, std::int64_t cv) {
      return static_cast<double>(Int128{bu} * cv - Int128{bv} * cu);
    };
    const double whole = area(b[u] - a[u], b[v] - a[v], c[u] - a[u], c[v] - a[v]);
    const double second = area(pu - a[u], pv - a[v], c[u] - a[u], c[v] - a[v]) / whole;
    const double third = area(b[u] - a[u], b[v] - a[v], pu - a[u], pv - a[v]) / whole;
    const auto [low, high] = std::minmax({a[axis], b[axis], c[axis]});
    const double depth = static_cast<double>(a[axis]) + second * static_cast<double>(b[axis] - a[axis]) +
                         third * static_cast<double>(c[axis] - a[axis]);
    return std::clamp(depth, static_cast<double>(low), static_cast<double>(high));
  }
};

/// First and last index whose cell's centre lies between the corners.
struct CentreRange {
  std::int64_t first, last;
  CentreRange(const SeenTriangle& triangle, std::size_t axis) {
    constexpr std::int64_t kHalf = geometry::kVoxelUnits / 2;
    const auto& [a, b, c] = triangle.corners;
    const auto [low, high] = std::minmax({(*a)[axis], (*b)[axis], (*c)[axis]});
    first = (low - kHalf + geometry::kVoxelUnits - 1) >> geometry::kFractionBits;
    last = (high - kHalf) >> geometry::kFractionBits;
  }
};

std::int64_t centre_of(std::int64_t index) { return index * geometry::kVoxelUnits + geometry::kVoxelUnits / 2; }

/// Marks, in every column of cells along the axis, the first cell whose centre lies behind each crossing; two crossings
/// there cancel.
void mark_crossings(const SeenTriangle& triangle, const VoxelBlock& block, std::vector<std::uint8_t>& marks) {
  const CentreRange columns(triangle, triangle.u), rows(triangle, triangle.v);
  for (std::int64_t row = rows.first; row <= rows.last; ++row) {
    for (std::int64_t column = columns.first; column <= columns.last; ++column) {
      const std::int64_t pu = centre_of(column), pv = centre_of(row);
      if (!triangle.covers(pu, pv)) continue;
      const double cells = triangle.depth(pu, pv) / static_cast<double>(geometry::kVoxelUnits);
      const int behind = static_cast<int>(std::floor(cells - 0.5)) + 1 - block.low[triangle.axis];
      std::array<int, 3> cell{};
      cell[triangle.u] = static_cast<int>(column) - block.low[triangle.u];
      cell[triangle.v] = static_cast<int>(row) - block.low[triangle.v];
      cell[triangle.axis] = std::min(behind, block.size[triangle.axis] - 1);
      marks[block.index(cell[0], cell[1], cell[2])] ^= 1;
    }
  }
}

/// Adds the rays along +axis and −axis of every cell.
void count_column(const std::vector<std::uint8_t>& marks, std::size_t start, std::size_t stride, int length,
                  std::vector<std::uint8_t>& odd) {
  std::uint8_t all = 0, before = 0;
  for (int i = 0; i < length; ++i) all ^= marks[start + at(i) * stride];
  for (int i = 0; i < length; ++i) {
    const std::size_t cell = start + at(i) * stride;
    before ^= marks[cell];
    odd[cell] = static_cast<std::uint8_t>(odd[cell] + before + (before ^ all));
  }
}

}  // namespace

std::vector<std::uint8_t> odd_rays(const std::vector<FixedPoint>& points, const std::vector<Triangle>& faces,
                                   const VoxelBlock& block) {
  std::vector<std::uint8_t> odd(block.cells(), 0), marks(block.cells());
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
    std::fill(marks.begin(), marks.end(), std::uint8_t{0});
    for (const Triangle& face : faces) {
      mark_crossings({{&points[at(face[0])], &points[at(face[1])], &points[at(face[2])]}, axis, u, v}, block, marks);
    }
    for (int i = 0; i < block.size[u]; ++i) {
      for (int j = 0; j < block.size[v]; ++j) {
        count_column(marks, at(i) * block.stride(u) + at(j) * block.stride(v), block.stride(axis), block.size[axis],
                     odd);
      }
    }
  }
  return odd;
}

}  // namespace anigen::rig
