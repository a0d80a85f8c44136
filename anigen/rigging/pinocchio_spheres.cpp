#include "anigen/rigging/pinocchio_spheres.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>
#include <tuple>
#include <utility>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/parallel.h"

namespace anigen::rigging {

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

constexpr int kWaySteps = 100;

bool stays_inside(const SolidField& field, const Sphere& a, const Sphere& b) {
  const double depth = -0.5 * std::min(a.radius, b.radius);
  for (int i = 0; i <= kWaySteps; ++i) {
    const double t = static_cast<double>(i) / kWaySteps;
    if (!(field.value((1.0 - t) * a.center + t * b.center) < depth)) return false;
  }
  return true;
}

/// Gabriel's condition: the ball with the two centres as diameter holds no third one.
bool nothing_between(const std::vector<Sphere>& spheres, std::size_t a, std::size_t b) {
  const Eigen::Vector3d middle = 0.5 * (spheres[a].center + spheres[b].center);
  const double squared = 0.25 * (spheres[a].center - spheres[b].center).squaredNorm();
  for (std::size_t c = 0; c < spheres.size(); ++c) {
    if (c != a && c != b && (spheres[c].center - middle).squaredNorm() < squared) return false;
  }
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
    const Eigen::Vector3d here = grid.center(cell);
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
  for (std::size_t cell = 0; cell < distance.size(); ++cell)
    distance[cell] = static_cast<float>((points[at(nearest[cell])] - grid.center(cell)).norm());
  return distance;
}

SphereGraph::SphereGraph(const SolidField& field, std::vector<Sphere> spheres) : spheres_(std::move(spheres)) {
  const std::size_t n = spheres_.size();
  neighbours_.resize(n);
  connect(field);
  bridge_pieces();
  for (auto& list : neighbours_) std::sort(list.begin(), list.end());
  distance_.assign(n * n, std::numeric_limits<float>::infinity());
  before_.assign(n * n, -1);
  parallel_for(n, [&](std::size_t from) { find_paths(static_cast<int>(from)); });
}

void SphereGraph::connect(const SolidField& field) {
  const std::size_t n = spheres_.size();
  std::vector<std::vector<int>> later(n);  // neighbours of a higher number
  parallel_for(n, [&](std::size_t a) {
    for (std::size_t b = a + 1; b < n; ++b) {
      const double apart = (spheres_[a].center - spheres_[b].center).norm();
      const bool intersect = apart < spheres_[a].radius + spheres_[b].radius;
      if (intersect || (nothing_between(spheres_, a, b) && stays_inside(field, spheres_[a], spheres_[b])))
        later[a].push_back(static_cast<int>(b));
    }
  });
  for (std::size_t a = 0; a < n; ++a) {
    for (const int b : later[a]) {
      neighbours_[a].push_back(b);
      neighbours_[at(b)].push_back(static_cast<int>(a));
    }
  }
}

void SphereGraph::bridge_pieces() {
  const std::size_t n = spheres_.size();
  DisjointSets sets(n);
  for (std::size_t a = 0; a < n; ++a) {
    for (const int b : neighbours_[a]) sets.join(a, at(b));
  }
  std::vector<std::tuple<double, int, int>> gaps;  // between pieces
  for (int a = 0; at(a) < n; ++a) {
    for (int b = a + 1; at(b) < n; ++b) {
      if (sets.same(at(a), at(b))) continue;
      const double gap =
          (spheres_[at(a)].center - spheres_[at(b)].center).norm() - spheres_[at(a)].radius - spheres_[at(b)].radius;
      gaps.emplace_back(gap, a, b);
    }
  }
  std::sort(gaps.begin(), gaps.end());
  for (const auto& [gap, a, b] : gaps) {
    if (!sets.join(at(a), at(b))) continue;
    neighbours_[at(a)].push_back(b);
    neighbours_[at(b)].push_back(a);
    ++bridges_;
  }
}

void SphereGraph::find_paths(int from) {
  std::vector<double> distance(size(), std::numeric_limits<double>::infinity());
  std::vector<char> done(size(), 0);
  using Entry = std::pair<double, int>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  distance[at(from)] = 0.0;
  open.emplace(0.0, from);
  while (!open.empty()) {
    const auto [d, v] = open.top();
    open.pop();
    if (done[at(v)] != 0) continue;
    done[at(v)] = 1;
    distance_[pair(from, v)] = static_cast<float>(d);
    for (const int w : neighbours_[at(v)]) {
      const double longer = d + (spheres_[at(v)].center - spheres_[at(w)].center).norm();
      if (longer >= distance[at(w)]) continue;
      distance[at(w)] = longer;
      before_[pair(from, w)] = static_cast<std::int16_t>(v);
      open.emplace(longer, w);
    }
  }
}

}  // namespace anigen::rigging
