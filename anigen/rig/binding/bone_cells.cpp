#include "anigen/rig/binding/bone_cells.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace anigen::rig {
namespace {

constexpr double kTouch = 1e-6;  ///< cells

/// The part of a line within a box, as fractions of the line; false when it stays outside.
bool clip_line(const Eigen::Vector3d& start, const Eigen::Vector3d& along, const Eigen::Vector3d& low,
               const Eigen::Vector3d& high, double& first, double& last) {
  first = 0.0;
  last = 1.0;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    if (along[axis] == 0.0) {
      if (start[axis] < low[axis] || start[axis] > high[axis]) return false;
      continue;
    }
    double in = (low[axis] - start[axis]) / along[axis], out = (high[axis] - start[axis]) / along[axis];
    if (in > out) std::swap(in, out);
    first = std::max(first, in);
    last = std::min(last, out);
  }
  return first <= last;
}

int cell_below(double coordinate) { return static_cast<int>(std::floor(coordinate - kTouch)); }
int cell_above(double coordinate) { return static_cast<int>(std::floor(coordinate + kTouch)); }

}  // namespace

void walk_line(const VoxelBlock& block, const BoneLine& line,
               const std::function<bool(const std::vector<std::uint32_t>&)>& visit) {
  const Eigen::Vector3d start = block.measured(line.start), along = block.measured(line.end) - start;
  const Eigen::Vector3d low = Eigen::Vector3d::Zero();
  const Eigen::Vector3d high(block.size[0], block.size[1], block.size[2]);
  double first = 0.0, last = 1.0;
  if (!clip_line(start, along, low, high, first, last)) return;
  Eigen::Index axis = 0;
  along.cwiseAbs().maxCoeff(&axis);
  const double from = start[axis] + first * along[axis], to = start[axis] + last * along[axis];
  const int step = along[axis] < 0.0 ? -1 : 1;
  const int first_slab = step > 0 ? cell_below(from) : cell_above(from);
  const int last_slab = step > 0 ? cell_above(to) : cell_below(to);
  std::vector<std::uint32_t> cells;
  for (int slab = first_slab; slab != last_slab + step; slab += step) {
    Eigen::Vector3d slab_low = low, slab_high = high;
    slab_low[axis] = slab - kTouch;
    slab_high[axis] = slab + 1 + kTouch;
    double enters = 0.0, leaves = 1.0;
    if (!clip_line(start, along, slab_low, slab_high, enters, leaves)) continue;
    const Eigen::Vector3d a = start + enters * along, b = start + leaves * along;
    std::array<int, 3> lowest{}, highest{};
    for (std::size_t k = 0; k < 3; ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      lowest[k] = i == axis ? slab : cell_below(std::min(a[i], b[i]));
      highest[k] = i == axis ? slab : cell_above(std::max(a[i], b[i]));
    }
    cells.clear();
    for (int x = lowest[0]; x <= highest[0]; ++x) {
      for (int y = lowest[1]; y <= highest[1]; ++y) {
        for (int z = lowest[2]; z <= highest[2]; ++z) {
          if (block.holds(x, y, z)) cells.push_back(static_cast<std::uint32_t>(block.index(x, y, z)));
        }
      }
    }
    if (!visit(cells)) return;
  }
}

}  // namespace anigen::rig
