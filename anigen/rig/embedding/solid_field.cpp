#include "anigen/rig/embedding/solid_field.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/voxelize.h"
#include "anigen/rig/embedding/solid_surface.h"

namespace anigen::rig {
namespace {

constexpr int kBorder = 3;              // cells of outside around the mesh
constexpr std::size_t kLoneParts = 63;  // parts that are judged one by one
constexpr double kHalfSheet = 0.75;     // of a cell

/// The cells around the mesh: an even number along every axis, so that a mirrored mesh has mirrored cells.
CellGrid grid_around(const Eigen::Vector3d& sides, double size, int resolution) {
  CellGrid grid;
  grid.spacing = size / resolution;
  const int half_cube = (resolution + 1) / 2 + kBorder;
  for (int axis = 0; axis < 3; ++axis) {
    const double half = 0.5 * sides[axis] / grid.spacing;
    const int cells = std::min(half_cube, static_cast<int>(std::ceil(half - 1e-6)) + kBorder);
    grid.size[at(axis)] = 2 * cells;
    grid.origin[axis] = (0.5 - cells) * grid.spacing;
  }
  return grid;
}

/// The cells that the surface passes through.
std::vector<std::uint8_t> surface_cells(const SolidSurface& surface, const CellGrid& grid, int resolution) {
  const int cube = 2 * ((resolution + 1) / 2 + kBorder);
  std::vector<Eigen::Vector3d> placed;
  placed.reserve(surface.vertices.size());
  for (const Eigen::Vector3d& vertex : surface.vertices) placed.push_back(vertex / (grid.spacing * cube));
  std::vector<std::uint8_t> wall(grid.count(), 0);
  for (const geometry::Voxel& voxel : geometry::voxelize_surface(placed, surface.faces, cube)) {
    std::array<int, 3> c{};
    for (std::size_t k = 0; k < 3; ++k) c[k] = voxel[k] - (cube - grid.size[k]) / 2;
    wall[grid.index(c[0], c[1], c[2])] = 1;
  }
  return wall;
}

Eigen::Vector3d center_of(const CellGrid& grid, std::size_t cell) {
  const auto c = grid.cell(cell);
  return grid.center(c[0], c[1], c[2]);
}

template <typename Visit>
void for_sides(const CellGrid& grid, std::size_t cell, const Visit& visit) {
  const auto c = grid.cell(cell);
  std::size_t step = 1;
  for (std::size_t k = 0; k < 3; ++k) {
    if (c[k] > 0) visit(cell - step);
    if (c[k] + 1 < grid.size[k]) visit(cell + step);
    step *= at(grid.size[k]);
  }
}

/// Cells that nothing but walls keeps from the border.
std::vector<std::uint8_t> reached_from_outside(const CellGrid& grid, const std::vector<std::uint8_t>& wall) {
  std::vector<std::uint8_t> reached(grid.count(), 0);
  std::vector<std::size_t> open{0};
  reached[0] = 1;
  while (!open.empty()) {
    const std::size_t cell = open.back();
    open.pop_back();
    for_sides(grid, cell, [&](std::size_t side) {
      if (reached[side] != 0 || wall[side] != 0) return;
      reached[side] = 1;
      open.push_back(side);
    });
  }
  return reached;
}

std::vector<std::uint8_t> inside_cells(const SolidSurface& surface, const CellGrid& grid,
                                       const std::vector<std::uint8_t>& wall) {
  std::vector<std::uint8_t> inside = reached_from_outside(grid, wall);
  for (std::size_t cell = 0; cell < inside.size(); ++cell) {
    inside[cell] = inside[cell] == 0 && wall[cell] == 0 ? 1 : 0;
  }
  std::vector<int> others;
  for (std::size_t part = 0; part < surface.parts.size(); ++part) {
    if (part < kLoneParts) {
      mark_surrounded(surface.vertices, surface.faces, surface.parts[part], grid, inside);
    } else {
      others.insert(others.end(), surface.parts[part].begin(), surface.parts[part].end());
    }
  }
  if (!others.empty()) mark_surrounded(surface.vertices, surface.faces, others, grid, inside);
  return inside;
}

bool any_around(const CellGrid& grid, const std::vector<std::uint8_t>& marks, std::size_t cell) {
  const auto c = grid.cell(cell);
  for (int z = std::max(0, c[2] - 1); z <= std::min(grid.size[2] - 1, c[2] + 1); ++z) {
    for (int y = std::max(0, c[1] - 1); y <= std::min(grid.size[1] - 1, c[1] + 1); ++y) {
      for (int x = std::max(0, c[0] - 1); x <= std::min(grid.size[0] - 1, c[0] + 1); ++x) {
        if (marks[grid.index(x, y, z)] != 0) return true;
      }
    }
  }
  return false;
}

}  // namespace

double interpolate(const CellGrid& grid, const std::vector<float>& values, const Eigen::Vector3d& point) {
  std::array<int, 3> low{};
  std::array<double, 3> part{};
  double beyond = 0.0;
  for (int axis = 0; axis < 3; ++axis) {
    const auto k = at(axis);
    const double x = (point[axis] - grid.origin[axis]) / grid.spacing;
    const double kept = std::clamp(x, 0.0, grid.size[k] - 1.0);
    beyond += (x - kept) * (x - kept);
    low[k] = std::min(static_cast<int>(kept), grid.size[k] - 2);
    part[k] = kept - low[k];
  }
  double sum = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    const int x = corner & 1, y = corner >> 1 & 1, z = corner >> 2;
    const double weight =
        (x != 0 ? part[0] : 1.0 - part[0]) * (y != 0 ? part[1] : 1.0 - part[1]) * (z != 0 ? part[2] : 1.0 - part[2]);
    sum += weight * static_cast<double>(values[grid.index(low[0] + x, low[1] + y, low[2] + z)]);
  }
  return sum + grid.spacing * std::sqrt(beyond);
}

double SolidField::value(const Eigen::Vector3d& point) const { return interpolate(grid, distance, point); }

std::size_t SolidField::inside_count() const {
  return static_cast<std::size_t>(std::count_if(distance.begin(), distance.end(), [](float d) { return d < 0.0F; }));
}

SolidField solid_field(const Mesh& mesh, double size, int resolution) {
  if (resolution < 8 || resolution > 512) {
    throw InputError("", "resolution",
                     "a solid has 8 to 512 cells along its longest side, not " + std::to_string(resolution));
  }
  const SolidSurface surface = solid_surface(mesh, size);
  SolidField field;
  field.from_mesh = surface.from_mesh;
  Box box;
  for (const Eigen::Vector3d& vertex : surface.vertices) box.extend(vertex);
  field.mesh_sides = box.high - box.low;
  field.grid = grid_around(field.mesh_sides, size, resolution);
  const CellGrid& grid = field.grid;
  field.half_sheet = kHalfSheet * grid.spacing;
  const std::vector<std::uint8_t> wall = surface_cells(surface, grid, resolution);
  const std::vector<std::uint8_t> inside = inside_cells(surface, grid, wall);

  std::vector<std::size_t> seeds;
  std::vector<Eigen::Vector3d> centers, between;
  for (std::size_t cell = 0; cell < grid.count(); ++cell) {
    const Eigen::Vector3d center = center_of(grid, cell);
    std::size_t other = cell;
    for_sides(grid, cell, [&](std::size_t side) { other = inside[side] != inside[cell] ? side : other; });
    const bool sheet = other == cell && wall[cell] != 0 && !any_around(grid, inside, cell);
    if (other == cell && !sheet) continue;
    seeds.push_back(cell);
    centers.push_back(center);
    between.push_back(0.5 * (center + center_of(grid, other)));
    field.sheet.push_back(sheet ? 1 : 0);
  }
  const geometry::NearestSurface nearest(surface.vertices, surface.faces);
  const std::vector<geometry::NearestPoint> found = nearest.query(centers);
  for (std::size_t i = 0; i < seeds.size(); ++i) {
    // Where a hole was closed there is no surface, and the boundary runs between the cells.
    field.boundary.push_back(found[i].distance <= grid.spacing ? found[i].position : between[i]);
  }

  field.seed = nearest_seeds(grid, field.boundary, seeds);
  field.distance.resize(grid.count());
  for (std::size_t cell = 0; cell < grid.count(); ++cell) {
    const auto seed = at(field.seed[cell]);
    const double d = (field.boundary[seed] - center_of(grid, cell)).norm();
    field.distance[cell] =
        static_cast<float>((inside[cell] != 0 ? -d : d) - (field.sheet[seed] != 0 ? field.half_sheet : 0.0));
  }
  return field;
}

}  // namespace anigen::rig
