#include "anigen/rig/embedding/sphere_graph.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <queue>
#include <tuple>
#include <utility>

#include "anigen/core/parallel.h"

namespace anigen::rig {
namespace {

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
      if (intersect || (nothing_between(spheres_, a, b) && stays_inside(field, spheres_[a], spheres_[b]))) {
        later[a].push_back(static_cast<int>(b));
      }
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
  std::vector<int> root(n);
  std::iota(root.begin(), root.end(), 0);
  const auto find = [&](int v) {
    while (root[at(v)] != v) v = root[at(v)] = root[at(root[at(v)])];
    return v;
  };
  for (std::size_t a = 0; a < n; ++a) {
    for (const int b : neighbours_[a]) root[at(find(b))] = find(static_cast<int>(a));
  }
  std::vector<std::tuple<double, int, int>> gaps;  // between pieces
  for (int a = 0; at(a) < n; ++a) {
    for (int b = a + 1; at(b) < n; ++b) {
      if (find(a) == find(b)) continue;
      const double gap =
          (spheres_[at(a)].center - spheres_[at(b)].center).norm() - spheres_[at(a)].radius - spheres_[at(b)].radius;
      gaps.emplace_back(gap, a, b);
    }
  }
  std::sort(gaps.begin(), gaps.end());
  for (const auto& [gap, a, b] : gaps) {
    if (find(a) == find(b)) continue;
    root[at(find(b))] = find(a);
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

}  // namespace anigen::rig
