#include "anigen/geometry/nearest_point.h"

#include <algorithm>
#include <cmath>
#include <nanoflann.hpp>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"

namespace anigen::geometry {

namespace {

constexpr std::size_t kLeafSize = 10;
constexpr std::size_t kPointQueriesPerTask = 1024;  // enough work per task to hide its cost

void require_reachable(const std::vector<Eigen::Vector3d>& points, const char* array) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    // Beyond it, squared distances would be infinite.
    if (points[i].allFinite() && points[i].cwiseAbs().maxCoeff() <= 1e100) continue;
    throw InputError("", std::string(array) + "[" + std::to_string(i) + "]", "not finite, or beyond 1e100");
  }
}

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

/// One nearest point; may start from a known one.
struct OneResult : PointIndex::Nearest {
  using DistanceType = double;
  using IndexType = std::size_t;
  using CountType = std::size_t;

  std::size_t size() const { return 1; }
  bool empty() const { return false; }
  bool full() const { return true; }
  void sort() {}
  /// A little more, so that the tree also shows points that are as near.
  // NOLINTBEGIN(readability-identifier-naming): names that nanoflann calls
  double worstDist() const { return squared * (1.0 + 1e-12) + std::numeric_limits<double>::denorm_min(); }
  bool addPoint(double distance, std::size_t candidate) {
    if (distance < squared || (distance == squared && candidate < index)) {
      squared = distance;
      index = candidate;
    }
    return true;
  }
  // NOLINTEND(readability-identifier-naming)
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
    return result;
  }

  point_tree::Cloud cloud;
  point_tree::Tree tree;
};

PointIndex::PointIndex(std::vector<Eigen::Vector3d> points) {
  if (points.empty()) throw InputError("", "points", "there is no point to search");
  require_reachable(points, "points");
  implementation_ = std::make_shared<Implementation>(std::move(points));
}

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

std::vector<std::size_t> PointIndex::nearest(const std::vector<Eigen::Vector3d>& queries) const {
  require_reachable(queries, "queries");
  std::vector<std::size_t> found(queries.size());
  parallel_for((queries.size() + kPointQueriesPerTask - 1) / kPointQueriesPerTask, [&](std::size_t block) {
    const std::size_t end = std::min(queries.size(), (block + 1) * kPointQueriesPerTask);
    for (std::size_t i = block * kPointQueriesPerTask; i < end; ++i) found[i] = nearest(queries[i]).index;
  });
  return found;
}

namespace {

constexpr std::int32_t kCellReach = 2;  // cells that a radius spans
constexpr std::size_t kCellRows = 25;   // (x, y) rows of cells around a cell, each contiguous by z
constexpr std::size_t kCellQueriesPerTask = 256;
// Two points that single precision finds just within the radius may truly be a few parts in 1e7 beyond it.
constexpr double kRoundingMargin = 1.0 + 1e-4;

}  // namespace

/// The part of a cell that a merge has not looked at yet.
struct PointCells::Run {
  int index;            // of the point at `at`
  std::size_t at, end;  // into order_
};

/// The cells around one cell, for cells visited in ascending order: since cells are sorted by (x, y, z), each of the 25
/// rows around a cell starts at or after where it started for the cell before.
class PointCells::Surroundings {
 public:
  Surroundings(const PointCells& all, std::size_t first) : all_(all) {
    for (std::size_t row = 0; row < kCellRows; ++row) starts_[row] = all.first_cell_from(row_start(first, row));
  }

  /// @param cell not before the one of the call before
  void move_to(std::size_t cell) {
    cells_.clear();
    const std::int32_t last_z = all_.cells_[cell].key[2] + kCellReach;
    for (std::size_t row = 0; row < kCellRows; ++row) {
      const Key from = row_start(cell, row);
      std::size_t& start = starts_[row];
      while (start < all_.cells_.size() && all_.cells_[start].key < from) ++start;
      for (std::size_t c = start; c < all_.cells_.size(); ++c) {
        const Key& key = all_.cells_[c].key;
        if (key[0] != from[0] || key[1] != from[1] || key[2] > last_z) break;
        cells_.push_back(c);
      }
    }
  }

  const std::vector<std::size_t>& cells() const { return cells_; }

 private:
  Key row_start(std::size_t cell, std::size_t row) const {
    const Key& key = all_.cells_[cell].key;
    const auto x = static_cast<std::int32_t>(row / 5), y = static_cast<std::int32_t>(row % 5);
    return {key[0] + x - kCellReach, key[1] + y - kCellReach, key[2] - kCellReach};
  }

  const PointCells& all_;
  std::array<std::size_t, kCellRows> starts_{};
  std::vector<std::size_t> cells_;
};

PointCells::PointCells(const std::vector<Eigen::Vector3f>& points, float radius)
    : radius_(radius), cell_size_(0.5 * static_cast<double>(radius) * kRoundingMargin), points_(points) {
  struct Entry {
    Key key;
    int index;
  };
  std::vector<Entry> entries;
  entries.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) entries.push_back({key_of(points[i]), static_cast<int>(i)});
  std::sort(entries.begin(), entries.end(),
            [](const Entry& a, const Entry& b) { return a.key != b.key ? a.key < b.key : a.index < b.index; });
  sorted_.reserve(points.size());
  order_.reserve(points.size());
  for (const Entry& entry : entries) {
    const Eigen::Vector3f& point = points[at(entry.index)];
    if (cells_.empty() || cells_.back().key != entry.key) {
      cells_.push_back({entry.key, order_.size(), order_.size(), point, point});
    }
    Cell& cell = cells_.back();
    cell.low = cell.low.cwiseMin(point);
    cell.high = cell.high.cwiseMax(point);
    order_.push_back(entry.index);
    sorted_.push_back(point);
    cell.end = order_.size();
  }
}

PointCells::Key PointCells::key_of(const Eigen::Vector3f& point) const {
  // Far points share the outermost cells, which is slower and still right: clamping never moves two points apart.
  constexpr double kMost = 1 << 30;
  Key key;
  for (int axis = 0; axis < 3; ++axis) {
    const double cell = std::floor(static_cast<double>(point[axis]) / cell_size_);
    key[at(axis)] = static_cast<std::int32_t>(std::clamp(cell, -kMost, kMost));
  }
  return key;
}

bool PointCells::in_reach(const Cell& cell, const Eigen::Vector3f& point) const {
  double squared = 0.0;
  for (int axis = 0; axis < 3; ++axis) {
    const double x = point[axis];
    const double gap =
        std::max({static_cast<double>(cell.low[axis]) - x, x - static_cast<double>(cell.high[axis]), 0.0});
    squared += gap * gap;
  }
  const double reach = static_cast<double>(radius_) * kRoundingMargin;
  return squared <= reach * reach;
}

std::size_t PointCells::first_cell_from(const Key& key) const {
  const auto found = std::lower_bound(cells_.begin(), cells_.end(), key,
                                      [](const Cell& cell, const Key& wanted) { return cell.key < wanted; });
  return static_cast<std::size_t>(found - cells_.begin());
}

void PointCells::merge_runs(const Eigen::Vector3f& point, std::size_t most, std::vector<Run>& runs,
                            std::vector<Neighbour>& found) const {
  found.clear();
  const float limit = radius_ * radius_;
  const auto later = [](const Run& a, const Run& b) { return a.index > b.index; };
  std::make_heap(runs.begin(), runs.end(), later);
  while (!runs.empty() && found.size() < most) {
    std::pop_heap(runs.begin(), runs.end(), later);
    Run& run = runs.back();
    // The lowest index of the other runs: up to there this one is ahead.
    const int others = runs.size() > 1 ? runs.front().index : -1;
    do {
      const float squared = squared_distance(sorted_[run.at], point);
      if (squared < limit) found.push_back({run.index, squared});
      ++run.at;
      if (run.at < run.end) run.index = order_[run.at];
    } while (run.at < run.end && found.size() < most && (others < 0 || run.index < others));
    if (run.at == run.end) {
      runs.pop_back();
    } else {
      std::push_heap(runs.begin(), runs.end(), later);
    }
  }
}

void PointCells::first_neighbours(std::size_t most, const Visit& visit) const {
  parallel_for((order_.size() + kCellQueriesPerTask - 1) / kCellQueriesPerTask, [&](std::size_t task) {
    const std::size_t begin = task * kCellQueriesPerTask, end = std::min(order_.size(), begin + kCellQueriesPerTask);
    const auto holder = std::upper_bound(cells_.begin(), cells_.end(), begin,
                                         [](std::size_t at, const Cell& cell) { return at < cell.end; });
    auto cell = static_cast<std::size_t>(holder - cells_.begin());
    Surroundings surroundings(*this, cell);
    surroundings.move_to(cell);
    std::vector<Run> runs;
    std::vector<Neighbour> found;
    for (std::size_t i = begin; i < end; ++i) {
      if (i == cells_[cell].end) surroundings.move_to(++cell);
      runs.clear();
      for (const std::size_t c : surroundings.cells()) {
        if (in_reach(cells_[c], sorted_[i])) runs.push_back({order_[cells_[c].begin], cells_[c].begin, cells_[c].end});
      }
      merge_runs(sorted_[i], most, runs, found);
      visit(static_cast<std::size_t>(order_[i]), found);
    }
  });
}

std::vector<int> PointCells::within(std::size_t point) const {
  const Eigen::Vector3f& center = points_[point];
  std::vector<int> found;
  const std::size_t own = first_cell_from(key_of(center));
  Surroundings surroundings(*this, own);
  surroundings.move_to(own);
  for (const std::size_t c : surroundings.cells()) {
    if (!in_reach(cells_[c], center)) continue;
    for (std::size_t i = cells_[c].begin; i < cells_[c].end; ++i) {
      if (std::sqrt(squared_distance(sorted_[i], center)) <= radius_) found.push_back(order_[i]);
    }
  }
  return found;
}

}  // namespace anigen::geometry
