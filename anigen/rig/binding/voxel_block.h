#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/geometry/voxel_grid.h"

namespace anigen::rig {

/// Part of a grid of R³ cubic cells (geometry/voxel_grid.h), with its own numbering: cell (i, j, k) of the block is
/// voxel low + (i, j, k), and cells lie z fastest. Points are measured in cells from the block's corner, so that cell
/// (i, j, k) is the box [i, i + 1] × [j, j + 1] × [k, k + 1].
struct VoxelBlock {
  int resolution = 0;           ///< R of the grid
  geometry::Voxel low{};        ///< voxel of the grid at cell (0, 0, 0); −1 along an axis is one before the grid
  std::array<int, 3> size{};    ///< cells along each axis
  double cells_per_unit = 0.0;  ///< of the frame that points are given in

  std::size_t cells() const { return extent(0) * extent(1) * extent(2); }
  std::size_t index(int i, int j, int k) const {
    return (static_cast<std::size_t>(i) * extent(1) + static_cast<std::size_t>(j)) * extent(2) +
           static_cast<std::size_t>(k);
  }
  /// How far apart neighbours along an axis are numbered.
  std::size_t stride(std::size_t axis) const { return axis == 2 ? 1 : axis == 1 ? extent(2) : extent(1) * extent(2); }
  bool holds(int i, int j, int k) const {
    return i >= 0 && j >= 0 && k >= 0 && i < size[0] && j < size[1] && k < size[2];
  }
  std::array<int, 3> cell(std::size_t index) const {
    return {static_cast<int>(index / stride(0)), static_cast<int>(index / extent(2) % extent(1)),
            static_cast<int>(index % extent(2))};
  }
  Eigen::Vector3d center(std::size_t index) const {
    const std::array<int, 3> c = cell(index);
    return {c[0] + 0.5, c[1] + 0.5, c[2] + 0.5};
  }
  /// A point of the unit frame, measured in cells.
  Eigen::Vector3d measured(const Eigen::Vector3d& point) const {
    return cells_per_unit * point +
           Eigen::Vector3d(0.5 * resolution - low[0], 0.5 * resolution - low[1], 0.5 * resolution - low[2]);
  }

 private:
  std::size_t extent(std::size_t axis) const { return static_cast<std::size_t>(size[axis]); }
};

}  // namespace anigen::rig
