#include "anigen/loaders/rignet/surface_paths.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <queue>

#include "anigen/asset/mesh_edges.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/geometry/surface_sampling.h"

namespace anigen::loaders {
namespace {

constexpr std::size_t kNearestLinks = 5;
constexpr float kLeastNormalCosine = -0.5F;
constexpr std::size_t kDrawsPerSample = 4;
constexpr double kSpacing = 0.7;  // of samples, in roots of their share of the area: fewer than this leaves room for

using Queue =
    std::priority_queue<std::pair<double, std::int32_t>, std::vector<std::pair<double, std::int32_t>>, std::greater<>>;

struct Cloud {
  std::vector<Eigen::Vector3f> points, normals;
};

Eigen::Vector3f corner_cross(const RignetMesh& mesh, const Triangle& face) {
  const Eigen::Vector3f& a = mesh.vertices[at(face[0])];
  return (mesh.vertices[at(face[1])] - a).cross(mesh.vertices[at(face[2])] - a);
}

// Uniform draws, those too near to an earlier one left out: a Poisson-disk sample.
void add_samples(const RignetMesh& mesh, std::size_t samples, std::uint64_t seed, Cloud& cloud) {
  double area = 0.0;
  for (const Triangle& face : mesh.faces) area += 0.5 * corner_cross(mesh, face).norm();
  const double apart = kSpacing * std::sqrt(area / static_cast<double>(std::max<std::size_t>(samples, 1)));
  const auto least = static_cast<float>(apart * apart);
  Rng rng(seed, "rignet surface samples");
  const std::size_t first = cloud.points.size();
  for (const auto& draw : geometry::sample_surface(mesh.vertices, mesh.faces, kDrawsPerSample * samples, rng)) {
    if (cloud.points.size() == first + samples) break;
    const Eigen::Vector3f place = geometry::position(draw, mesh.vertices, mesh.faces).cast<float>();
    bool is_free = true;
    for (std::size_t i = first; is_free && i < cloud.points.size(); ++i) {
      is_free = (cloud.points[i] - place).squaredNorm() >= least;
    }
    if (!is_free) continue;
    cloud.points.push_back(place);
    cloud.normals.push_back(corner_cross(mesh, mesh.faces[at(draw.face)]).normalized());
  }
}

// Pairs of each point with its nearest ones of compatible normals.
void add_nearest(const Cloud& cloud, std::vector<std::pair<std::int32_t, std::int32_t>>& pairs) {
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    std::array<std::pair<float, std::int32_t>, kNearestLinks> best;
    best.fill({std::numeric_limits<float>::infinity(), -1});
    for (std::size_t j = 0; j < cloud.points.size(); ++j) {
      const float squared = (cloud.points[i] - cloud.points[j]).squaredNorm();
      if (j == i || squared >= best.back().first) continue;
      if (cloud.normals[i].dot(cloud.normals[j]) <= kLeastNormalCosine) continue;
      best.back() = {squared, static_cast<std::int32_t>(j)};
      for (std::size_t k = kNearestLinks - 1; k > 0 && best[k].first < best[k - 1].first; --k) {
        std::swap(best[k], best[k - 1]);
      }
    }
    for (const auto& [squared, j] : best) {
      if (j >= 0) pairs.emplace_back(static_cast<std::int32_t>(i), j);
    }
  }
}

}  // namespace

SurfacePaths::SurfacePaths(const RignetMesh& mesh, std::size_t samples, std::uint64_t seed)
    : vertices_(mesh.vertices.size()) {
  Cloud cloud{mesh.vertices, vertex_normals(mesh.vertices, mesh.faces)};
  add_samples(mesh, samples, seed, cloud);
  std::vector<std::pair<std::int32_t, std::int32_t>> pairs;
  const MeshEdges edges(mesh.faces, vertices_);
  for (const MeshEdges::Edge& edge : edges.all()) pairs.emplace_back(edge[0], edge[1]);
  add_nearest(cloud, pairs);
  points_ = std::move(cloud.points);
  join(pairs);
}

void SurfacePaths::join(const std::vector<std::pair<std::int32_t, std::int32_t>>& pairs) {
  std::vector<std::pair<std::int32_t, std::int32_t>> both = pairs;
  for (const auto& [a, b] : pairs) both.emplace_back(b, a);
  std::sort(both.begin(), both.end());
  both.erase(std::unique(both.begin(), both.end()), both.end());
  first_link_.assign(points_.size() + 1, 0);
  for (const auto& [a, b] : both) {
    links_.push_back({b, (points_[at(a)] - points_[at(b)]).norm()});
    first_link_[at(a) + 1] = links_.size();
  }
  for (std::size_t i = 1; i < first_link_.size(); ++i) first_link_[i] = std::max(first_link_[i], first_link_[i - 1]);
}

std::vector<SurfacePaths::Reached> SurfacePaths::within(std::int32_t vertex, double radius) const {
  std::vector<double> distance(points_.size(), std::numeric_limits<double>::infinity());
  std::vector<Reached> found;
  Queue open;
  distance[at(vertex)] = 0.0;
  open.push({0.0, vertex});
  while (!open.empty()) {
    const auto [here, point] = open.top();
    open.pop();
    if (here > distance[at(point)]) continue;
    if (at(point) < vertices_ && point != vertex) found.push_back({point, here});
    for (std::size_t l = first_link_[at(point)]; l < first_link_[at(point) + 1]; ++l) {
      const double there = here + links_[l].length;
      if (there >= radius || there >= distance[at(links_[l].to)]) continue;
      distance[at(links_[l].to)] = there;
      open.push({there, links_[l].to});
    }
  }
  return found;
}

std::vector<SurfacePaths::Nearest> SurfacePaths::from(const std::vector<std::int32_t>& sources) const {
  std::vector<double> distance(points_.size(), std::numeric_limits<double>::infinity());
  std::vector<std::int32_t> source(points_.size(), -1);
  Queue open;
  for (const std::int32_t vertex : sources) {
    distance[at(vertex)] = 0.0;
    source[at(vertex)] = vertex;
    open.push({0.0, vertex});
  }
  while (!open.empty()) {
    const auto [here, point] = open.top();
    open.pop();
    if (here > distance[at(point)]) continue;
    for (std::size_t l = first_link_[at(point)]; l < first_link_[at(point) + 1]; ++l) {
      const double there = here + links_[l].length;
      if (there >= distance[at(links_[l].to)]) continue;
      distance[at(links_[l].to)] = there;
      source[at(links_[l].to)] = source[at(point)];
      open.push({there, links_[l].to});
    }
  }
  std::vector<Nearest> nearest(vertices_);
  for (std::size_t v = 0; v < vertices_; ++v) {
    if (source[v] >= 0) nearest[v] = {source[v], distance[v]};
  }
  return nearest;
}

}  // namespace anigen::loaders
