#include "anigen/geometry/nearest_vertex.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"

namespace anigen::geometry {
namespace {

constexpr std::int32_t kVerticesPerLeaf = 12;
constexpr std::size_t kVertexQueriesPerTask = 1024;  // enough work per task to hide its cost

void require_reachable(const Eigen::Vector3d& point, const char* array, std::size_t index) {
  // Beyond it, squared distances would be infinite.
  if (point.allFinite() && point.cwiseAbs().maxCoeff() <= 1e100) return;
  throw InputError("", std::string(array) + "[" + std::to_string(index) + "]", "not finite, or beyond 1e100");
}

}  // namespace

struct NearestVertex::Best {
  Eigen::Vector3d point;
  std::int32_t vertex = -1;
  double squared = std::numeric_limits<double>::infinity();
};

NearestVertex::NearestVertex(const std::vector<Eigen::Vector3f>& vertices) {
  if (vertices.empty()) throw InputError("", "vertices", "there is no vertex to be near to");
  if (vertices.size() > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max())) {
    throw InputError("", "vertices", "too many vertices");
  }
  vertices_.reserve(vertices.size());
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    vertices_.push_back(vertices[v].cast<double>());
    require_reachable(vertices_.back(), "vertices", v);
  }
  original_.resize(vertices.size());
  std::iota(original_.begin(), original_.end(), 0);
  build(0, static_cast<std::int32_t>(vertices.size()));
  std::vector<Eigen::Vector3d> sorted;
  sorted.reserve(vertices_.size());
  for (const std::int32_t index : original_) sorted.push_back(vertices_[static_cast<std::size_t>(index)]);
  vertices_ = std::move(sorted);
}

// While the tree grows, original_ is being put in its order and vertices_ is still in that of the mesh.
std::int32_t NearestVertex::build(std::int32_t begin, std::int32_t end) {
  const auto id = static_cast<std::int32_t>(nodes_.size());
  nodes_.emplace_back();
  nodes_.back().begin = begin;
  nodes_.back().end = end;
  if (end - begin <= kVerticesPerLeaf) return id;
  const auto at = [&](std::int32_t place) -> const Eigen::Vector3d& {
    return vertices_[static_cast<std::size_t>(original_[static_cast<std::size_t>(place)])];
  };
  Eigen::Vector3d low = at(begin), high = at(begin);
  for (std::int32_t place = begin + 1; place < end; ++place) {
    low = low.cwiseMin(at(place));
    high = high.cwiseMax(at(place));
  }
  int axis = 0;
  const double extent = (high - low).maxCoeff(&axis);
  if (!(extent > 0.0)) return id;  // all in one place
  const std::int32_t middle = begin + (end - begin) / 2;
  const auto along = [&](std::int32_t a) { return vertices_[static_cast<std::size_t>(a)][axis]; };
  std::nth_element(original_.begin() + begin, original_.begin() + middle, original_.begin() + end,
                   [&](std::int32_t a, std::int32_t b) { return along(a) < along(b); });
  const double plane = at(middle)[axis];
  const std::int32_t below = build(begin, middle), above = build(middle, end);
  Node& node = nodes_[static_cast<std::size_t>(id)];
  node.axis = axis;
  node.plane = plane;
  node.below = below;
  node.above = above;
  return id;
}

void NearestVertex::search(std::int32_t id, Best& best) const {
  const Node& node = nodes_[static_cast<std::size_t>(id)];
  if (node.below < 0) {
    for (std::int32_t place = node.begin; place < node.end; ++place) {
      const double squared = (vertices_[static_cast<std::size_t>(place)] - best.point).squaredNorm();
      const std::int32_t vertex = original_[static_cast<std::size_t>(place)];
      if (squared < best.squared || (squared == best.squared && vertex < best.vertex)) {
        best.squared = squared;
        best.vertex = vertex;
      }
    }
    return;
  }
  const double beyond = best.point[node.axis] - node.plane;
  search(beyond < 0.0 ? node.below : node.above, best);
  // Equally near vertices behind the plane may have a lower index.
  if (beyond * beyond <= best.squared) search(beyond < 0.0 ? node.above : node.below, best);
}

std::int32_t NearestVertex::query(const Eigen::Vector3d& point) const {
  Best best;
  best.point = point;
  search(0, best);
  return best.vertex;
}

std::vector<std::int32_t> NearestVertex::query(const std::vector<Eigen::Vector3d>& points) const {
  for (std::size_t i = 0; i < points.size(); ++i) require_reachable(points[i], "points", i);
  std::vector<std::int32_t> nearest(points.size());
  parallel_for((points.size() + kVertexQueriesPerTask - 1) / kVertexQueriesPerTask, [&](std::size_t block) {
    const std::size_t end = std::min(points.size(), (block + 1) * kVertexQueriesPerTask);
    for (std::size_t i = block * kVertexQueriesPerTask; i < end; ++i) nearest[i] = query(points[i]);
  });
  return nearest;
}

}  // namespace anigen::geometry
