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

/// The triangles of a mesh as solids need them: corners in one place are one vertex (files split them at texture
/// seams), what no face uses is gone, and so are faces without three different corners, unless there are no others.
struct SolidSurface {
  std::vector<Eigen::Vector3d> vertices;  ///< centre of the box at the origin, longest side as asked for
  std::vector<Triangle> faces;
  std::vector<std::vector<int>> parts;  ///< faces that hang together by vertices, largest area first
  Similarity from_mesh;                 ///< mesh → vertices
};

/// @param size longest side of the result's box
/// @throws InputError for a mesh without faces or without extent, a face that refers to a missing vertex, or a vertex
/// of a face that is not finite
SolidSurface solid_surface(const Mesh& mesh, double size);

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

/// Inside of a mesh, and its depth: signed distance to the boundary of the solid, negative inside, at the cells of
/// a regular grid.
///
/// Meshes need not be closed. A cell is inside when nothing leads from it to the outside that does not pass a cell of
/// the surface, or when one of the parts of the mesh surrounds it (mark_surrounded): so overlapping parts are one
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
/// @throws InputError as solid_surface(), or for a bad resolution
SolidField solid_field(const Mesh& mesh, double size, int resolution);

/// value() for any array of a grid.
double interpolate(const CellGrid& grid, const std::vector<float>& values, const Eigen::Vector3d& point);

/// The nearest of some points for every cell of a grid. A cell learns of points from its neighbours only, which now and
/// then gives a point that is farther than the nearest by a small part of a cell.
/// @param seeds [points], the cell that each belongs to @return [cells], -1 everywhere without points
std::vector<std::int32_t> nearest_seeds(const CellGrid& grid, const std::vector<Eigen::Vector3d>& points,
                                        const std::vector<std::size_t>& seeds);

}  // namespace anigen::rigging
