#include "anigen/rig/embedding/medial_spheres.h"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace anigen::rig {
namespace {

/// Boundary points are known one to a cell: two that are nearer than this many cells belong to one side of the solid.
constexpr double kLeastApart = 2.0;

/// The point between two cells that is equally far from their boundary points, if the medial surface passes there.
bool medial_between(const Eigen::Vector3d& p, const Eigen::Vector3d& p_boundary, const Eigen::Vector3d& q,
                    const Eigen::Vector3d& q_boundary, Sphere& sphere) {
  // |x − a|² − |x − b|² is linear along the way from p, which is nearer to its own a, to q.
  const double at_p = (p - p_boundary).squaredNorm() - (p - q_boundary).squaredNorm();
  const double at_q = (q - p_boundary).squaredNorm() - (q - q_boundary).squaredNorm();
  if (!(at_p <= 0.0 && at_q >= 0.0) || at_q - at_p <= 0.0) return false;
  sphere.center = p - at_p / (at_q - at_p) * (q - p);
  if ((sphere.center - p_boundary).dot(sphere.center - q_boundary) > 0.0) return false;
  sphere.radius = (sphere.center - p_boundary).norm();
  return true;
}

}  // namespace

std::vector<Sphere> medial_samples(const SolidField& field, double least_radius) {
  const CellGrid& grid = field.grid;
  std::vector<Sphere> samples;
  const std::array<std::size_t, 3> step{1, at(grid.size[0]), at(grid.size[0]) * at(grid.size[1])};
  for (std::size_t cell = 0; cell < grid.count(); ++cell) {
    if (!(field.distance[cell] < 0.0F)) continue;
    const auto c = grid.cell(cell);
    const Eigen::Vector3d here = grid.center(c[0], c[1], c[2]);
    const auto seed = at(field.seed[cell]);
    if (field.sheet[seed] != 0) {
      samples.push_back({field.boundary[seed], field.half_sheet});
      continue;
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (c[axis] + 1 >= grid.size[axis]) continue;
      const std::size_t next = cell + step[axis];
      const auto next_seed = at(field.seed[next]);
      if (!(field.distance[next] < 0.0F) || next_seed == seed || field.sheet[next_seed] != 0) continue;
      Eigen::Vector3d there = here;
      there[static_cast<Eigen::Index>(axis)] += grid.spacing;
      Sphere sphere;
      if (!medial_between(here, field.boundary[seed], there, field.boundary[next_seed], sphere)) continue;
      if ((field.boundary[seed] - field.boundary[next_seed]).norm() < kLeastApart * grid.spacing) continue;
      if (sphere.radius > least_radius) samples.push_back(sphere);
    }
  }
  std::sort(samples.begin(), samples.end(), [](const Sphere& a, const Sphere& b) {
    return std::make_tuple(-a.radius, a.center.z(), a.center.y(), a.center.x()) <
           std::make_tuple(-b.radius, b.center.z(), b.center.y(), b.center.x());
  });
  return samples;
}

std::vector<Sphere> packed_spheres(const std::vector<Sphere>& samples, std::size_t most) {
  std::vector<Sphere> packed;
  for (const Sphere& sample : samples) {
    if (packed.size() >= most) break;
    // From the end: the spheres of about the same size that were taken last are the likeliest to hold the centre.
    const bool covered = std::any_of(packed.rbegin(), packed.rend(), [&](const Sphere& taken) {
      return (taken.center - sample.center).squaredNorm() < taken.radius * taken.radius;
    });
    if (!covered) packed.push_back(sample);
  }
  return packed;
}

std::vector<float> distance_to_medial(const SolidField& field, const std::vector<Sphere>& samples) {
  const CellGrid& grid = field.grid;
  std::vector<Eigen::Vector3d> points;
  std::vector<std::size_t> cells;
  for (const Sphere& sample : samples) {
    std::array<int, 3> c{};
    for (int axis = 0; axis < 3; ++axis) {
      const auto i = static_cast<int>(std::lround((sample.center[axis] - grid.origin[axis]) / grid.spacing));
      c[at(axis)] = std::clamp(i, 0, grid.size[at(axis)] - 1);
    }
    points.push_back(sample.center);
    cells.push_back(grid.index(c[0], c[1], c[2]));
  }
  const std::vector<std::int32_t> nearest = nearest_seeds(grid, points, cells);
  std::vector<float> distance(grid.count());
  for (std::size_t cell = 0; cell < distance.size(); ++cell) {
    const auto c = grid.cell(cell);
    distance[cell] = static_cast<float>((points[at(nearest[cell])] - grid.center(c[0], c[1], c[2])).norm());
  }
  return distance;
}

}  // namespace anigen::rig
