#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/core/numeric.h"

namespace anigen::rig {

/// Cells of a regular grid, x fastest.
struct CellGrid {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< centre of cell (0, 0, 0)
  double spacing = 1.0;
  std::array<int, 3> size{};

  std::size_t count() const { return at(size[0]) * at(size[1]) * at(size[2]); }
  std::size_t index(int x, int y, int z) const { return (at(z) * at(size[1]) + at(y)) * at(size[0]) + at(x); }
  Eigen::Vector3d center(int x, int y, int z) const { return origin + spacing * Eigen::Vector3d(x, y, z); }
  std::array<int, 3> cell(std::size_t index) const {
    const auto row = index / at(size[0]);
    return {static_cast<int>(index % at(size[0])), static_cast<int>(row % at(size[1])),
            static_cast<int>(row / at(size[1]))};
  }
};

/// Marks cells whose centre a part of a surface surrounds: of the six rays along the axes at least four cross it an odd
/// number of times. Which way faces point does not matter, and a part with a hole or two (a sleeve, a skirt, a mask)
/// still counts as the solid it suggests. Time grows with the faces' area in cells, memory with the cells.
/// @param faces of this part @param inside [cells], set to 1 where surrounded, else left as it is
void mark_surrounded(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& all_faces,
                     const std::vector<int>& faces, const CellGrid& grid, std::vector<std::uint8_t>& inside);

}  // namespace anigen::rig
