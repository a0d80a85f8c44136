#include "anigen/geometry/voxel_segment.h"

#include <cstdlib>

namespace anigen::geometry {
namespace {

/// The crossings of voxel borders along one axis.
struct Walk {
  std::int64_t cell, left;       ///< where it is, and how many crossings are to come
  std::int64_t reached, length;  ///< the next crossing happens at the fraction reached / length of the segment
  int step;

  Walk(std::int64_t from, std::int64_t to)
      : cell(from >> kFractionBits), length(std::abs(to - from)), step(to < from ? -1 : 1) {
    left = std::abs((to >> kFractionBits) - cell);
    reached = step > 0 ? (cell + 1) * kVoxelUnits - from : from - cell * kVoxelUnits;
  }

  void cross() {
    cell += step;
    reached += kVoxelUnits;
    --left;
  }
};

/// < 0 when a crosses first. A point on a border belongs to the upper voxel: going up, the voxel changes on the
/// border, going down just after it.
int order(const Walk& a, const Walk& b) {
  const Int128 first = Int128{a.reached} * b.length, second = Int128{b.reached} * a.length;
  if (first != second) return first < second ? -1 : 1;
  return b.step - a.step;
}

}  // namespace

void append_segment(const FixedPoint& from, const FixedPoint& to, std::vector<Voxel>& voxels) {
  std::array<Walk, 3> axes = {Walk(from[0], to[0]), Walk(from[1], to[1]), Walk(from[2], to[2])};
  for (;;) {
    voxels.push_back({static_cast<std::int32_t>(axes[0].cell), static_cast<std::int32_t>(axes[1].cell),
                      static_cast<std::int32_t>(axes[2].cell)});
    const Walk* next = nullptr;
    for (const Walk& axis : axes) {
      if (axis.left > 0 && (next == nullptr || order(axis, *next) < 0)) next = &axis;
    }
    if (next == nullptr) return;
    const Walk first = *next;
    for (Walk& axis : axes) {
      if (axis.left > 0 && order(axis, first) == 0) axis.cross();
    }
  }
}

}  // namespace anigen::geometry
