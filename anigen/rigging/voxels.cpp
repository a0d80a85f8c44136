#include "anigen/rigging/voxels.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"

namespace anigen::rigging {

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

/// Out of the six rays from the centre of each cell along the axes, how many cross the surface an odd number of times:
/// 6 inside a closed surface and 0 outside, whatever the winding of its faces; between them near holes. Which rays meet
/// a triangle is decided in integers with a rule for rays through edges and vertices, so that no ray slips between two
/// triangles; where along the ray is rounded, which matters only in cells that the surface passes through.
/// Runs on one thread. Memory: two bytes per cell.
/// @param points in the grid's fixed point @param faces of points
/// @return [cells] @pre the block covers the surface
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

/// The mesh's longest side as a part of the grid's: a little room, so that nothing lies on the grid's border.
constexpr double kFilled = 1.0 - 1.0 / 1024.0;
constexpr std::uint8_t kOddMajority = 4;  ///< of six rays

std::vector<Eigen::Vector3d> in_grid(const WeldedSurface& surface) {
  std::vector<Eigen::Vector3d> points;
  points.reserve(surface.places.size());
  // Places without faces may lie anywhere; nothing reads them.
  for (const Eigen::Vector3d& place : surface.places) points.push_back(geometry::clip_to_cube(kFilled * place));
  return points;
}

VoxelBlock block_around(const std::vector<geometry::Voxel>& voxels, int resolution) {
  VoxelBlock block;
  block.resolution = resolution;
  block.cells_per_unit = kFilled * resolution;
  geometry::Voxel low = voxels.front(), high = voxels.front();
  for (const geometry::Voxel& voxel : voxels) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], voxel[axis]);
      high[axis] = std::max(high[axis], voxel[axis]);
    }
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    block.low[axis] = low[axis] - 1;
    block.size[axis] = high[axis] - low[axis] + 3;
  }
  return block;
}

/// The six cells that share a face with one. @pre not at the block's border
std::array<std::size_t, 6> face_neighbours(const VoxelBlock& block, std::size_t cell) {
  const std::size_t x = block.stride(0), y = block.stride(1);
  return {cell - x, cell + x, cell - y, cell + y, cell - 1, cell + 1};
}

bool at_border(const VoxelBlock& block, std::size_t cell) {
  const std::array<int, 3> c = block.cell(cell);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (c[axis] == 0 || c[axis] == block.size[axis] - 1) return true;
  }
  return false;
}

/// Turns what is not a wall and cannot be reached from the border into the inside. The border itself is never a wall.
void flood_from_outside(SolidVoxels& solid) {
  const VoxelBlock& block = solid.block;
  std::vector<std::uint32_t> open;
  const auto reach = [&](std::size_t cell) {
    if (solid.states[cell] != SolidVoxels::kInside) return;
    solid.states[cell] = SolidVoxels::kOutside;
    open.push_back(static_cast<std::uint32_t>(cell));
  };
  const auto from_border = [&](int i, std::size_t axis) { return std::min(i, block.size[axis] - 1 - i); };
  std::size_t cell = 0;
  for (int i = 0; i < block.size[0]; ++i) {
    for (int j = 0; j < block.size[1]; ++j) {
      const int side = std::min(from_border(i, 0), from_border(j, 1));
      for (int k = 0; k < block.size[2]; ++k, ++cell) {
        std::uint8_t& state = solid.states[cell];
        const int away = std::min(side, from_border(k, 2));
        state = away > 0 && state == SolidVoxels::kOutside ? std::uint8_t{SolidVoxels::kInside} : state;
        if (away == 1) reach(cell);  // the border hangs together, so that it need not be walked
      }
    }
  }
  while (!open.empty()) {
    const std::size_t reached = open.back();
    open.pop_back();
    for (const std::size_t neighbour : face_neighbours(block, reached)) reach(neighbour);
  }
}

/// Cells that the flood reached and rays find inside, ascending.
std::vector<std::uint32_t> behind_holes(const SolidVoxels& solid, const std::vector<std::uint8_t>& odd) {
  std::vector<std::uint32_t> cells;
  for (std::size_t cell = 0; cell < odd.size(); ++cell) {
    if (odd[cell] < kOddMajority || solid.states[cell] != SolidVoxels::kOutside || at_border(solid.block, cell))
      continue;
    cells.push_back(static_cast<std::uint32_t>(cell));
  }
  return cells;
}

/// Takes back cells of which most neighbours are outside. All are judged before any is taken back.
void drop_streaks(SolidVoxels& solid, const std::vector<std::uint32_t>& voted) {
  std::vector<std::uint32_t> dropped;
  for (const std::uint32_t cell : voted) {
    int outside = 0;
    for (const std::size_t neighbour : face_neighbours(solid.block, cell)) outside += !solid.is_solid(neighbour);
    if (outside > 3) dropped.push_back(cell);
  }
  for (const std::uint32_t cell : dropped) solid.states[cell] = SolidVoxels::kOutside;
}

/// Marks cells that a bone touches, and those next to them.
std::vector<bool> near_bones(const VoxelBlock& block, const std::vector<MovingBones>& bones) {
  std::vector<bool> near(block.cells(), false);
  const auto mark = [&](const std::vector<std::uint32_t>& cells) {
    for (const std::uint32_t cell : cells) {
      const std::array<int, 3> c = block.cell(cell);
      for (int dx = -1; dx <= 1; ++dx) {
        for (int dy = -1; dy <= 1; ++dy) {
          for (int dz = -1; dz <= 1; ++dz) {
            if (block.holds(c[0] + dx, c[1] + dy, c[2] + dz)) near[block.index(c[0] + dx, c[1] + dy, c[2] + dz)] = true;
          }
        }
      }
    }
    return true;
  };
  for (const MovingBones& joint : bones) {
    for (const BoneLine& line : joint.lines) walk_line(block, line, mark);
  }
  return near;
}

/// Inside cells that hang together by faces and lie next to no bone go outside.
void drop_boneless(SolidVoxels& solid, const std::vector<bool>& near) {
  std::vector<bool> seen(solid.states.size(), false);
  std::vector<std::uint32_t> component;
  for (std::size_t start = 0; start < solid.states.size(); ++start) {
    if (solid.states[start] != SolidVoxels::kInside || seen[start]) continue;
    component.assign(1, static_cast<std::uint32_t>(start));
    seen[start] = true;
    bool has_bone = false;
    for (std::size_t next = 0; next < component.size(); ++next) {
      has_bone = has_bone || near[component[next]];
      for (const std::size_t neighbour : face_neighbours(solid.block, component[next])) {
        if (solid.states[neighbour] != SolidVoxels::kInside || seen[neighbour]) continue;
        seen[neighbour] = true;
        component.push_back(static_cast<std::uint32_t>(neighbour));
      }
    }
    if (has_bone) continue;
    for (const std::uint32_t cell : component) solid.states[cell] = SolidVoxels::kOutside;
  }
}

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

SolidVoxels solid_voxels(const WeldedSurface& surface, const std::vector<MovingBones>& bones, int resolution,
                         bool validate) {
  if (resolution < 2 || resolution > kMaxSolidResolution) {
    throw InputError("", "resolution",
                     "a mesh is bound in 2 to " + std::to_string(kMaxSolidResolution) +
                         " voxels along its longest side, not " + std::to_string(resolution));
  }
  const std::vector<Eigen::Vector3d> points = in_grid(surface);
  SolidVoxels solid;
  {
    const std::vector<geometry::Voxel> walls = geometry::voxelize_surface(points, surface.faces, resolution);
    solid.block = block_around(walls, resolution);
    solid.states.assign(solid.block.cells(), SolidVoxels::kOutside);
    const geometry::Voxel& low = solid.block.low;
    for (const geometry::Voxel& wall : walls) {
      const std::size_t cell = solid.block.index(wall[0] - low[0], wall[1] - low[1], wall[2] - low[2]);
      solid.states[cell] = SolidVoxels::kWall;
      solid.walls.push_back(static_cast<std::uint32_t>(cell));
    }
  }
  flood_from_outside(solid);
  std::vector<std::uint32_t> voted;
  {
    std::vector<geometry::FixedPoint> fixed;
    fixed.reserve(points.size());
    for (const Eigen::Vector3d& point : points) fixed.push_back(geometry::to_fixed(point, resolution));
    voted = behind_holes(solid, odd_rays(fixed, surface.faces, solid.block));
  }
  for (const std::uint32_t cell : voted) solid.states[cell] = SolidVoxels::kInside;
  if (validate) {
    drop_streaks(solid, voted);
    drop_boneless(solid, near_bones(solid.block, bones));
  }
  return solid;
}

PathBounds::PathBounds(const SolidVoxels& solid, std::size_t most)
    : solid_(&solid), most_(most), row_(at(solid.block.size[2])) {
  for (std::size_t axis = 0; axis < 3; ++axis) blocks_along_[axis] = (at(solid.block.size[axis]) + kSide - 1) / kSide;
  if (most_ == 0) return;
  for (int i = 0; i < solid.block.size[0]; ++i) {
    for (int j = 0; j < solid.block.size[1]; ++j)
      block_of_row_.push_back((at(i) / kSide * blocks_along_[1] + at(j) / kSide) * blocks_along_[2]);
  }
  nearest_.assign(blocks_along_[0] * blocks_along_[1] * blocks_along_[2] * most_, kUnbounded);
}

void PathBounds::add(const std::vector<std::pair<const std::vector<float>*, double>>& joints) {
  if (most_ == 0) return;
  const std::size_t rows = at(solid_->block.size[1]), slabs = at(solid_->block.size[0]);
  parallel_for(blocks_along_[0], [&](std::size_t slab) {
    std::vector<float> farthest(blocks_along_[1] * blocks_along_[2]);
    for (const auto& [distances, before] : joints) {
      // Outside is −∞, and so are the blocks that lie outside altogether.
      std::fill(farthest.begin(), farthest.end(), -std::numeric_limits<float>::infinity());
      for (std::size_t x = slab * kSide; x < std::min(slabs, (slab + 1) * kSide); ++x) {
        for (std::size_t y = 0; y < rows; ++y) {
          const float* row = distances->data() + (x * rows + y) * row_;
          float* blocks = farthest.data() + y / kSide * blocks_along_[2];
          for (std::size_t z = 0; z < row_; ++z) blocks[z / kSide] = std::max(blocks[z / kSide], row[z]);
        }
      }
      for (std::size_t b = 0; b < farthest.size(); ++b) {
        float* kept = nearest_.data() + (slab * farthest.size() + b) * most_;
        // Rounded up: a bound may be too large.
        const auto distance = static_cast<float>((static_cast<double>(farthest[b]) + before) * (1.0 + 1e-6) + 1e-3);
        if (!(distance < kept[most_ - 1])) continue;
        std::size_t place = most_ - 1;
        for (; place > 0 && distance < kept[place - 1]; --place) kept[place] = kept[place - 1];
        kept[place] = distance;
      }
    }
  });
}

VoxelPaths::VoxelPaths(const SolidVoxels& solid) : solid_(&solid), distances_(solid.states.size()) {
  const auto x = static_cast<std::ptrdiff_t>(solid.block.stride(0));
  const auto y = static_cast<std::ptrdiff_t>(solid.block.stride(1));
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        const int squared = dx * dx + dy * dy + dz * dz;
        if (squared > 0) steps_.push_back({dx * x + dy * y + dz, std::sqrt(static_cast<float>(squared))});
      }
    }
  }
}

void VoxelPaths::offer(std::size_t cell, float distance) {
  // Cells outside hold −∞: one comparison tells them, too.
  if (!(distance < distances_[cell])) return;
  distances_[cell] = distance;
  buckets_[static_cast<std::uint32_t>(static_cast<std::int32_t>(distance)) % 3].push_back(
      {static_cast<std::uint32_t>(cell), distance});
}

const std::vector<float>& VoxelPaths::run(const std::vector<PathSource>& sources, const PathBounds& bounds,
                                          double before) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  for (std::size_t cell = 0; cell < distances_.size(); ++cell)
    distances_[cell] = solid_->is_solid(cell) ? kInfinity : -kInfinity;
  for (const PathSource& source : sources) offer(source.cell, source.distance);
  // The longest step is shorter than two buckets, so from a bucket paths reach the next two.
  for (std::size_t bucket = 0, empty = 0; empty < 3; ++bucket) {
    std::vector<Entry>& entries = buckets_[bucket % 3];
    empty = entries.empty() ? empty + 1 : 0;
    for (const Entry& entry : entries) {
      if (entry.distance != distances_[entry.cell]) continue;  // a shorter path was found since
      if (entry.distance + before > static_cast<double>(bounds.at_cell(entry.cell))) continue;
      for (const Step& step : steps_) {
        offer(static_cast<std::size_t>(static_cast<std::ptrdiff_t>(entry.cell) + step.offset),
              entry.distance + step.length);
      }
    }
    entries.clear();
  }
  return distances_;
}

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

}  // namespace anigen::rigging
