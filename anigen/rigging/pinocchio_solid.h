#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/core/numeric.h"

namespace anigen::rigging {

/// Cells of a regular grid, x fastest.
struct CellGrid {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< centre of cell (0, 0, 0)
  double spacing = 1.0;
  std::array<int, 3> size{};

  std::size_t count() const { return at(size[0]) * at(size[1]) * at(size[2]); }
  std::size_t index(int x, int y, int z) const { return (at(z) * at(size[1]) + at(y)) * at(size[0]) + at(x); }
  Eigen::Vector3d center(int x, int y, int z) const { return origin + spacing * Eigen::Vector3d(x, y, z); }
  Eigen::Vector3d center(std::size_t index) const {
    const auto c = cell(index);
    return center(c[0], c[1], c[2]);
  }
  std::array<int, 3> cell(std::size_t index) const {
    const auto row = index / at(size[0]);
    return {static_cast<int>(index % at(size[0])), static_cast<int>(row % at(size[1])),
            static_cast<int>(row / at(size[1]))};
  }
};

/// Inside of a mesh, and its depth: signed distance to the boundary of the solid, negative inside, at the cells of
/// a regular grid.
///
/// Meshes need not be closed. A cell is inside when nothing leads from it to the outside that does not pass a cell of
/// the surface, or when a part of the mesh surrounds it (of the six rays
/// along the axes from its centre at least four cross the part an odd number of times): so overlapping parts are one
/// solid, what lies inside it (eyes, teeth, the hidden end of an arm) has no boundary, holes are closed, and which way
/// faces point does not matter. A sheet that surrounds nothing (a cape, a wing) is given a thickness of one and a half
/// cells. Beyond the 63 largest parts the others are judged together.
struct SolidField {
  CellGrid grid;                          ///< three cells of outside all around; the mesh is centred in it
  std::vector<float> distance;            ///< [cells]
  std::vector<std::int32_t> seed;         ///< [cells], index of the nearest known boundary point
  std::vector<Eigen::Vector3d> boundary;  ///< points of the surface, one for every cell next to the boundary
  std::vector<std::uint8_t> sheet;  ///< [boundary], 1: of a sheet, whose half thickness is subtracted from distances
  double half_sheet = 0.0;
  Similarity from_mesh;                                  ///< mesh → the frame of the field
  Eigen::Vector3d mesh_sides = Eigen::Vector3d::Zero();  ///< of the mesh's box, in the frame of the field

  /// Linear between cells; outside the grid the value at its border and the way to there.
  double value(const Eigen::Vector3d& point) const;
  std::size_t inside_count() const;
};

/// @param size longest side of the mesh's box in the frame of the field, whose origin is the box's centre
/// @param resolution cells along it, 8 to 512. Memory: some 12 bytes a cell
/// @throws InputError for a mesh without faces or extent, a face that refers to a missing vertex, a vertex of a face
/// that is not finite, or a bad resolution
SolidField solid_field(const Mesh& mesh, double size, int resolution);

/// value() for any array of a grid.
double interpolate(const CellGrid& grid, const std::vector<float>& values, const Eigen::Vector3d& point);

/// The nearest of some points for every cell of a grid. A cell learns of points from its neighbours only, which now and
/// then gives a point that is farther than the nearest by a small part of a cell.
/// @param seeds [points], the cell that each belongs to @return [cells], -1 everywhere without points
std::vector<std::int32_t> nearest_seeds(const CellGrid& grid, const std::vector<Eigen::Vector3d>& points,
                                        const std::vector<std::size_t>& seeds);

/// Faces that hang together by vertices, by the first face of each group. @param vertices how many there are
std::vector<std::vector<int>> connected_faces(std::size_t vertices, const std::vector<Triangle>& faces);

}  // namespace anigen::rigging
