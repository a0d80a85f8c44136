#include "anigen/eval/surface/point_index.h"

#include <limits>
#include <nanoflann.hpp>
#include <string>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

constexpr double kLargestCoordinate = 1e100;  // its square is still finite
constexpr std::size_t kLeafSize = 10;

}  // namespace

// Named, since a member of PointIndex::Implementation has it as a type.
namespace point_tree {

/// The points as nanoflann wants to see them.
struct Cloud {
  std::vector<Eigen::Vector3d> points;

  std::size_t kdtree_get_point_count() const { return points.size(); }
  double kdtree_get_pt(std::size_t index, std::size_t axis) const {
    return points[index][static_cast<Eigen::Index>(axis)];
  }
  template <typename Bounds>
  bool kdtree_get_bbox(Bounds&) const {
    return false;
  }
};

/// One nearest point; may start from a known one. Among equally near points the tree happens to visit, the lowest.
struct OneResult {
  using DistanceType = double;
  using IndexType = std::size_t;
  using CountType = std::size_t;
  double squared = std::numeric_limits<double>::max();
  std::size_t index = 0;

  std::size_t size() const { return 1; }
  bool empty() const { return false; }
  bool full() const { return true; }
  void sort() {}
  double worstDist() const { return squared; }
  bool addPoint(double distance, std::size_t candidate) {
    if (distance < squared || (distance == squared && candidate < index)) {
      squared = distance;
      index = candidate;
    }
    return true;
  }
};

using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Cloud>, Cloud, 3, std::size_t>;

}  // namespace point_tree

struct PointIndex::Implementation {
  explicit Implementation(std::vector<Eigen::Vector3d> points)
      : cloud{std::move(points)}, tree(3, cloud, nanoflann::KDTreeSingleIndexAdaptorParams(kLeafSize)) {}

  Nearest search(const Eigen::Vector3d& query, point_tree::OneResult result) const {
#if NANOFLANN_VERSION < 0x150
    tree.findNeighbors(result, query.data(), nanoflann::SearchParams());
#else
    tree.findNeighbors(result, query.data());
#endif
    return {result.index, result.squared};
  }

  point_tree::Cloud cloud;
  point_tree::Tree tree;
};

PointIndex::PointIndex(std::vector<Eigen::Vector3d> points) {
  if (points.empty()) throw InputError("", "points", "there is no point to search");
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!(points[i].cwiseAbs().maxCoeff() <= kLargestCoordinate) || !points[i].allFinite()) {
      throw InputError("", "points[" + std::to_string(i) + "]", "the position is not finite or larger than 1e100");
    }
  }
  implementation_ = std::make_unique<Implementation>(std::move(points));
}

PointIndex::~PointIndex() = default;
PointIndex::PointIndex(PointIndex&&) noexcept = default;
PointIndex& PointIndex::operator=(PointIndex&&) noexcept = default;

std::size_t PointIndex::size() const { return implementation_->cloud.points.size(); }

const Eigen::Vector3d& PointIndex::point(std::size_t index) const { return implementation_->cloud.points[index]; }

PointIndex::Nearest PointIndex::nearest(const Eigen::Vector3d& query) const {
  return implementation_->search(query, point_tree::OneResult{});
}

PointIndex::Nearest PointIndex::nearest(const Eigen::Vector3d& query, std::size_t guess) const {
  point_tree::OneResult result;
  result.index = guess;
  const Eigen::Vector3d offset = query - point(guess);
  // Summed in the tree's order, so that the guess itself is found again as equal.
  result.squared = offset.x() * offset.x() + offset.y() * offset.y() + offset.z() * offset.z();
  return implementation_->search(query, result);
}

}  // namespace anigen::eval
