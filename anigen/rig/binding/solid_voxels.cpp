#include "anigen/rig/binding/solid_voxels.h"

#include <algorithm>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/voxelize.h"
#include "anigen/rig/binding/bone_cells.h"
#include "anigen/rig/binding/ray_parity.h"

namespace anigen::rig {
namespace {

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
  for (std::uint8_t& state : solid.states) {
    if (state == SolidVoxels::kOutside) state = SolidVoxels::kInside;
  }
  std::vector<std::uint32_t> open;
  const auto reach = [&](std::size_t cell) {
    if (solid.states[cell] != SolidVoxels::kInside) return;
    solid.states[cell] = SolidVoxels::kOutside;
    open.push_back(static_cast<std::uint32_t>(cell));
  };
  for (int i = 0; i < block.size[0]; ++i) {
    for (int j = 0; j < block.size[1]; ++j) {
      const bool side = i == 0 || j == 0 || i == block.size[0] - 1 || j == block.size[1] - 1;
      for (int k = 0; k < block.size[2]; k += side ? 1 : block.size[2] - 1) {
        solid.states[block.index(i, j, k)] = SolidVoxels::kOutside;
      }
    }
  }
  // Once around the border is enough: it hangs together.
  for (int i = 1; i + 1 < block.size[0]; ++i) {
    for (int j = 1; j + 1 < block.size[1]; ++j) {
      reach(block.index(i, j, 1));
      reach(block.index(i, j, block.size[2] - 2));
    }
    for (int k = 1; k + 1 < block.size[2]; ++k) {
      reach(block.index(i, 1, k));
      reach(block.index(i, block.size[1] - 2, k));
    }
  }
  for (int j = 1; j + 1 < block.size[1]; ++j) {
    for (int k = 1; k + 1 < block.size[2]; ++k) {
      reach(block.index(1, j, k));
      reach(block.index(block.size[0] - 2, j, k));
    }
  }
  while (!open.empty()) {
    const std::size_t cell = open.back();
    open.pop_back();
    for (const std::size_t neighbour : face_neighbours(block, cell)) reach(neighbour);
  }
}

/// Cells that the flood reached and rays find inside, ascending.
std::vector<std::uint32_t> behind_holes(const SolidVoxels& solid, const std::vector<std::uint8_t>& odd) {
  std::vector<std::uint32_t> cells;
  for (std::size_t cell = 0; cell < odd.size(); ++cell) {
    if (odd[cell] < kOddMajority || solid.states[cell] != SolidVoxels::kOutside || at_border(solid.block, cell)) {
      continue;
    }
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

}  // namespace anigen::rig
