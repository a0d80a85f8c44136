#include "anigen/rig/embedding/solid_field.h"

namespace anigen::rig {
namespace {

/// One pass over all cells, away from one corner of the grid: every cell looks at the seven that came before it.
void sweep_from_corner(const CellGrid& grid, const std::vector<Eigen::Vector3d>& points, int corner,
                       std::vector<std::int32_t>& seed, std::vector<double>& squared) {
  const std::array<int, 3> step{(corner & 1) != 0 ? -1 : 1, (corner & 2) != 0 ? -1 : 1, (corner & 4) != 0 ? -1 : 1};
  const auto place = [&](int i, std::size_t axis) { return step[axis] > 0 ? i : grid.size[axis] - 1 - i; };
  for (int k = 0; k < grid.size[2]; ++k) {
    for (int j = 0; j < grid.size[1]; ++j) {
      for (int i = 0; i < grid.size[0]; ++i) {
        const int x = place(i, 0), y = place(j, 1), z = place(k, 2);
        const std::size_t cell = grid.index(x, y, z);
        const Eigen::Vector3d center = grid.center(x, y, z);
        for (int back = 1; back < 8; ++back) {
          const int bx = back & 1, by = back >> 1 & 1, bz = back >> 2;
          if (i < bx || j < by || k < bz) continue;
          const std::int32_t known = seed[grid.index(x - bx * step[0], y - by * step[1], z - bz * step[2])];
          if (known < 0 || known == seed[cell]) continue;
          const double d = (points[at(known)] - center).squaredNorm();
          if (d < squared[cell]) {
            squared[cell] = d;
            seed[cell] = known;
          }
        }
      }
    }
  }
}

}  // namespace

std::vector<std::int32_t> nearest_seeds(const CellGrid& grid, const std::vector<Eigen::Vector3d>& points,
                                        const std::vector<std::size_t>& seeds) {
  std::vector<std::int32_t> seed(grid.count(), -1);
  std::vector<double> squared(grid.count(), 1e300);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto c = grid.cell(seeds[i]);
    const double d = (points[i] - grid.center(c[0], c[1], c[2])).squaredNorm();
    if (d < squared[seeds[i]]) {
      squared[seeds[i]] = d;
      seed[seeds[i]] = static_cast<std::int32_t>(i);
    }
  }
  // Opposite corners in turn; the first pass, again, carries on what the others found.
  for (const int corner : {0, 7, 1, 6, 2, 5, 3, 4, 0}) sweep_from_corner(grid, points, corner, seed, squared);
  return seed;
}

}  // namespace anigen::rig
