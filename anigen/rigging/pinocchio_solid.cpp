#include "anigen/rigging/pinocchio_solid.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>
#include <tuple>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/error.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/voxelize.h"

namespace anigen::rigging {

namespace {

/// The triangles of a mesh as solids need them: corners in one place are one vertex (files split them at texture
/// seams), what no face uses is gone, and so are faces without three different corners, unless there are no others.
struct SolidSurface {
  std::vector<Eigen::Vector3d> vertices;  ///< centre of the box at the origin, longest side as asked for
  std::vector<Triangle> faces;
  std::vector<std::vector<int>> parts;  ///< faces that hang together by vertices, largest area first
  Similarity from_mesh;                 ///< mesh → vertices
};

Box checked_box(const Mesh& mesh) {
  if (mesh.faces.empty()) throw InputError("", "mesh.faces", "a mesh without faces has no inside to put a skeleton in");
  Box box;
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const std::int32_t v : mesh.faces[f]) {
      if (v < 0 || at(v) >= mesh.vertices.size())
        throw InputError("", "mesh.faces[" + std::to_string(f) + "]", "there is no vertex " + std::to_string(v));
      const Eigen::Vector3f& vertex = mesh.vertices[at(v)];
      if (!vertex.allFinite())
        throw InputError("", "mesh.vertices[" + std::to_string(v) + "]", "the vertex is not finite");
      box.extend(vertex.cast<double>());
    }
  }
  if (!(box.longest_side() > 0.0))
    throw InputError("", "mesh", "all vertices of its faces lie in one point, so it has no extent");
  return box;
}

/// For every vertex that a face uses the first one in the same place; -1 for others.
std::vector<int> welded(const Mesh& mesh) {
  std::vector<char> used(mesh.vertices.size(), 0);
  for (const Triangle& face : mesh.faces) {
    for (const std::int32_t v : face) used[at(v)] = 1;
  }
  std::vector<int> order;
  for (std::size_t v = 0; v < used.size(); ++v) {
    if (used[v] != 0) order.push_back(static_cast<int>(v));
  }
  const auto place = [&](int v) {
    const Eigen::Vector3f& p = mesh.vertices[at(v)];
    return std::make_tuple(p.x(), p.y(), p.z());
  };
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    const auto pa = place(a), pb = place(b);
    return pa != pb ? pa < pb : a < b;
  });
  std::vector<int> first(mesh.vertices.size(), -1);
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool same = i > 0 && place(order[i]) == place(order[i - 1]);
    first[at(order[i])] = same ? first[at(order[i - 1])] : order[i];
  }
  return first;
}

double area_of(const SolidSurface& surface, const std::vector<int>& faces) {
  double sum = 0.0;
  for (const int f : faces) {
    const Triangle& t = surface.faces[at(f)];
    const Eigen::Vector3d& a = surface.vertices[at(t[0])];
    sum += (surface.vertices[at(t[1])] - a).cross(surface.vertices[at(t[2])] - a).norm();
  }
  return sum;
}

std::vector<std::vector<int>> connected_parts(const SolidSurface& surface) {
  std::vector<std::vector<int>> parts = connected_faces(surface.vertices.size(), surface.faces);
  std::vector<double> areas;
  for (const auto& part : parts) areas.push_back(area_of(surface, part));
  std::vector<std::size_t> order(parts.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return areas[a] > areas[b]; });
  std::vector<std::vector<int>> sorted;
  for (const std::size_t part : order) sorted.push_back(std::move(parts[part]));
  return sorted;
}

SolidSurface solid_surface(const Mesh& mesh, double size) {
  const Box box = checked_box(mesh);
  SolidSurface surface;
  surface.from_mesh.scale = size / box.longest_side();
  surface.from_mesh.offset = -surface.from_mesh.scale * box.center();
  std::vector<int> first = welded(mesh);
  std::vector<int> number(mesh.vertices.size(), -1);
  for (std::size_t v = 0; v < first.size(); ++v) {
    if (first[v] < 0) continue;
    if (at(first[v]) == v) {
      number[v] = static_cast<int>(surface.vertices.size());
      surface.vertices.push_back(surface.from_mesh.scale * mesh.vertices[v].cast<double>() + surface.from_mesh.offset);
    }
  }
  std::vector<Triangle> all;
  for (const Triangle& face : mesh.faces) {
    const Triangle t{number[at(first[at(face[0])])], number[at(first[at(face[1])])], number[at(first[at(face[2])])]};
    all.push_back(t);
    if (t[0] != t[1] && t[1] != t[2] && t[2] != t[0]) surface.faces.push_back(t);
  }
  if (surface.faces.empty()) surface.faces = std::move(all);
  surface.parts = connected_parts(surface);
  return surface;
}

constexpr int kVotesInside = 4;

/// True when the number of crossings below a cell is odd, for all cells of a box, along one axis. A crossing flips all
/// cells above it, so that crossings need not be kept.
class CrossingParity {
 public:
  CrossingParity(const std::array<int, 3>& low, const std::array<int, 3>& size, int axis)
      : axis_(at(axis)), u_((axis_ + 1) % 3), v_((axis_ + 2) % 3), low_(low), size_(size) {
    words_ = (at(size[axis_]) + 63) / 64;
    bits_.assign(at(size[u_]) * at(size[v_]) * words_, 0);
    total_.assign(at(size[u_]) * at(size[v_]), 0);
  }

  /// Corners in cells: the centre of cell (0, 0, 0) of the grid is the origin.
  void add(const std::array<Eigen::Vector3d, 3>& corners, const Triangle& numbers) {
    // Rays a little beside the centres: on models, edges like to run exactly through them.
    constexpr double kBesideU = 1.37e-4, kBesideV = 2.71e-4;
    std::array<double, 3> x{}, y{}, z{};
    for (std::size_t k = 0; k < 3; ++k) {
      x[k] = corners[k][static_cast<Eigen::Index>(u_)] - low_[u_] - kBesideU;
      y[k] = corners[k][static_cast<Eigen::Index>(v_)] - low_[v_] - kBesideV;
      z[k] = corners[k][static_cast<Eigen::Index>(axis_)] - low_[axis_];
    }
    const auto [x_low, x_high] = std::minmax_element(x.begin(), x.end());
    const auto [y_low, y_high] = std::minmax_element(y.begin(), y.end());
    const int i_first = std::max(0, static_cast<int>(std::ceil(*x_low)));
    const int i_last = std::min(size_[u_] - 1, static_cast<int>(std::floor(*x_high)));
    const int j_first = std::max(0, static_cast<int>(std::ceil(*y_low)));
    const int j_last = std::min(size_[v_] - 1, static_cast<int>(std::floor(*y_high)));
    for (int j = j_first; j <= j_last; ++j) {
      for (int i = i_first; i <= i_last; ++i) {
        std::array<double, 3> w{};
        int positive = 0;
        for (std::size_t k = 0; k < 3; ++k) {
          // Always from the lower to the higher vertex, so that both faces of an edge see the same number.
          std::size_t a = (k + 1) % 3, b = (k + 2) % 3;
          const bool swapped = numbers[a] > numbers[b];
          if (swapped) std::swap(a, b);
          const double side = (x[b] - x[a]) * (j - y[a]) - (y[b] - y[a]) * (i - x[a]);
          positive += (side >= 0.0) != swapped ? 1 : 0;
          w[k] = swapped ? -side : side;
        }
        if (positive != 0 && positive != 3) continue;
        const double sum = w[0] + w[1] + w[2];
        if (sum == 0.0) continue;
        cross(i, j, (w[0] * z[0] + w[1] * z[1] + w[2] * z[2]) / sum);
      }
    }
  }

  /// Odd crossings along the rays to both sides of a cell of the box.
  int votes(const std::array<int, 3>& cell) const {
    const std::size_t column = at(cell[v_]) * at(size_[u_]) + at(cell[u_]);
    const std::uint64_t word = bits_[column * words_ + at(cell[axis_]) / 64];
    const int below = static_cast<int>(word >> (cell[axis_] % 64) & 1);
    return below + (below ^ total_[column]);
  }

 private:
  void cross(int i, int j, double depth) {
    const std::size_t column = at(j) * at(size_[u_]) + at(i);
    total_[column] ^= 1;
    const double last = size_[axis_];
    const auto first = static_cast<std::size_t>(std::clamp(std::floor(depth) + 1.0, 0.0, last));
    for (std::size_t w = first / 64; w < words_; ++w) {
      const bool starts_here = w == first / 64;
      bits_[column * words_ + w] ^= starts_here ? ~std::uint64_t{0} << (first % 64) : ~std::uint64_t{0};
    }
  }

  std::size_t axis_, u_, v_;
  std::array<int, 3> low_, size_;
  std::size_t words_;
  std::vector<std::uint64_t> bits_;
  std::vector<std::uint8_t> total_;
};

/// Marks cells whose centre a part of a surface surrounds: of the six rays along the axes at least four cross it an odd
/// number of times. Which way faces point does not matter, and a part with a hole or two (a sleeve, a skirt, a mask)
/// still counts as the solid it suggests. Time grows with the faces' area in cells, memory with the cells.
/// @param faces of this part @param inside [cells], set to 1 where surrounded, else left as it is
void mark_surrounded(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& all_faces,
                     const std::vector<int>& faces, const CellGrid& grid, std::vector<std::uint8_t>& inside) {
  const auto corners_of = [&](int f) {
    std::array<Eigen::Vector3d, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) corners[k] = (vertices[at(all_faces[at(f)][k])] - grid.origin) / grid.spacing;
    return corners;
  };
  Box box;
  for (const int f : faces) {
    for (const Eigen::Vector3d& corner : corners_of(f)) box.extend(corner);
  }
  std::array<int, 3> low{}, size{};
  for (int axis = 0; axis < 3; ++axis) {
    const auto k = at(axis);
    low[k] = std::clamp(static_cast<int>(std::floor(box.low[axis])), 0, grid.size[k] - 1);
    const int high = std::clamp(static_cast<int>(std::ceil(box.high[axis])), low[k], grid.size[k] - 1);
    size[k] = high - low[k] + 1;
  }
  std::array<CrossingParity, 3> axes{CrossingParity(low, size, 0), CrossingParity(low, size, 1),
                                     CrossingParity(low, size, 2)};
  for (const int f : faces) {
    const auto corners = corners_of(f);
    for (CrossingParity& axis : axes) axis.add(corners, all_faces[at(f)]);
  }
  for (int z = 0; z < size[2]; ++z) {
    for (int y = 0; y < size[1]; ++y) {
      for (int x = 0; x < size[0]; ++x) {
        int votes = 0;
        for (const CrossingParity& axis : axes) votes += axis.votes({x, y, z});
        if (votes >= kVotesInside) inside[grid.index(low[0] + x, low[1] + y, low[2] + z)] = 1;
      }
    }
  }
}

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
  for (std::size_t cell = 0; cell < inside.size(); ++cell) inside[cell] = inside[cell] == 0 && wall[cell] == 0 ? 1 : 0;
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

/// One pass over all cells, away from one corner of the grid: every cell looks at the seven that came before it.
void sweep_from_corner(const CellGrid& grid, const std::vector<Eigen::Vector3d>& points, int corner,
                       std::vector<std::int32_t>& seed, std::vector<double>& squared) {
  const std::array<int, 3> step{(corner & 1) != 0 ? -1 : 1, (corner & 2) != 0 ? -1 : 1, (corner & 4) != 0 ? -1 : 1};
  const auto place = [&](int i, std::size_t axis) { return step[axis] > 0 ? i : grid.size[axis] - 1 - i; };
  const std::ptrdiff_t row = grid.size[0], layer = row * grid.size[1];
  for (int k = 0; k < grid.size[2]; ++k) {
    for (int j = 0; j < grid.size[1]; ++j) {
      // Ways back to those of the seven that are there: first those of the same x, then the others.
      std::array<std::ptrdiff_t, 7> back{};
      std::size_t beside = 0, all = 0;
      for (const int bx : {0, 1}) {
        for (int others = 1 - bx; others < 4; ++others) {
          const int by = others & 1, bz = others >> 1;
          if (j >= by && k >= bz) back[all++] = bx * step[0] + by * step[1] * row + bz * step[2] * layer;
        }
        if (bx == 0) beside = all;
      }
      const int y = place(j, 1), z = place(k, 2);
      for (int i = 0; i < grid.size[0]; ++i) {
        const int x = place(i, 0);
        const std::size_t cell = grid.index(x, y, z);
        const Eigen::Vector3d center = grid.center(x, y, z);
        std::int32_t nearest = seed[cell], last = nearest;
        double least = squared[cell];
        const std::size_t count = i > 0 ? all : beside;
        for (std::size_t n = 0; n < count; ++n) {
          const std::int32_t known = seed[static_cast<std::size_t>(static_cast<std::ptrdiff_t>(cell) - back[n])];
          if (known < 0 || known == last || known == nearest) continue;
          last = known;
          const double d = (points[at(known)] - center).squaredNorm();
          if (d < least) {
            least = d;
            nearest = known;
          }
        }
        seed[cell] = nearest;
        squared[cell] = least;
      }
    }
  }
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

std::vector<std::int32_t> nearest_seeds(const CellGrid& grid, const std::vector<Eigen::Vector3d>& points,
                                        const std::vector<std::size_t>& seeds) {
  std::vector<std::int32_t> seed(grid.count(), -1);
  std::vector<double> squared(grid.count(), 1e300);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double d = (points[i] - grid.center(seeds[i])).squaredNorm();
    if (d < squared[seeds[i]]) {
      squared[seeds[i]] = d;
      seed[seeds[i]] = static_cast<std::int32_t>(i);
    }
  }
  // Opposite corners in turn; the first pass, again, carries on what the others found.
  for (const int corner : {0, 7, 1, 6, 2, 5, 3, 4, 0}) sweep_from_corner(grid, points, corner, seed, squared);
  return seed;
}

std::vector<std::vector<int>> connected_faces(std::size_t vertices, const std::vector<Triangle>& faces) {
  DisjointSets sets(vertices);
  for (const Triangle& t : faces) {
    sets.join(at(t[0]), at(t[1]));
    sets.join(at(t[0]), at(t[2]));
  }
  std::vector<int> part_of(vertices, -1);
  std::vector<std::vector<int>> parts;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    int& part = part_of[sets.find(at(faces[f][0]))];
    if (part < 0) {
      part = static_cast<int>(parts.size());
      parts.emplace_back();
    }
    parts[at(part)].push_back(static_cast<int>(f));
  }
  return parts;
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
    const Eigen::Vector3d center = grid.center(cell);
    std::size_t other = cell;
    for_sides(grid, cell, [&](std::size_t side) { other = inside[side] != inside[cell] ? side : other; });
    const bool sheet = other == cell && wall[cell] != 0 && !any_around(grid, inside, cell);
    if (other == cell && !sheet) continue;
    seeds.push_back(cell);
    centers.push_back(center);
    between.push_back(0.5 * (center + grid.center(other)));
    field.sheet.push_back(sheet ? 1 : 0);
  }
  const geometry::NearestSurface nearest(surface.vertices, surface.faces);
  const std::vector<geometry::NearestPoint> found = nearest.query(centers);
  for (std::size_t i = 0; i < seeds.size(); ++i) {
    // At a closed hole there is no surface, and the boundary runs between the cells.
    field.boundary.push_back(found[i].distance <= grid.spacing ? found[i].position : between[i]);
  }

  field.seed = nearest_seeds(grid, field.boundary, seeds);
  field.distance.resize(grid.count());
  for (std::size_t cell = 0; cell < grid.count(); ++cell) {
    const auto seed = at(field.seed[cell]);
    const double d = (field.boundary[seed] - grid.center(cell)).norm();
    field.distance[cell] =
        static_cast<float>((inside[cell] != 0 ? -d : d) - (field.sheet[seed] != 0 ? field.half_sheet : 0.0));
  }
  return field;
}

}  // namespace anigen::rigging
