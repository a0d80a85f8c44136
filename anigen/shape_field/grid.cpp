#include "anigen/shape_field/grid.h"

#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace anigen::shape_field {

namespace {

constexpr int kDigitBits = 11;
constexpr std::int64_t kDigitMask = (1 << kDigitBits) - 1;
constexpr std::int64_t kRowsPerTask = 1 << 14;

constexpr std::int64_t kPointsPerTask = 256;
constexpr std::int64_t kMostIndexedSide = 1025;  // 8 MB

// The nearest vertices found so far, ascending by distance, then row.
class NearestList {
 public:
  explicit NearestList(std::int64_t most) : most_(static_cast<std::size_t>(most)) { found_.reserve(most_ + 1); }

  void clear() { found_.clear(); }
  void offer(double squared, std::int64_t row) {
    const std::pair<double, std::int64_t> entry{squared, row};
    if (std::isnan(squared) || (full() && !(entry < found_.back()))) return;
    found_.insert(std::upper_bound(found_.begin(), found_.end(), entry), entry);
    if (found_.size() > most_) found_.pop_back();
  }
  bool full() const { return found_.size() == most_; }
  double farthest() const { return found_.back().first; }
  const std::vector<std::pair<double, std::int64_t>>& entries() const { return found_; }

 private:
  std::size_t most_;
  std::vector<std::pair<double, std::int64_t>> found_;
};

class VertexSearch {
 public:
  VertexSearch(const CubeField& field, bool deformed)
      : resolution_(field.resolution),
        grid_{field.resolution + 1},
        vertices_(grid_numbers(field.vertices, grid_)),
        positions_((deformed ? field.positions() : field.grid_positions())
                       .detach()
                       .to(torch::kCPU, torch::kFloat64)
                       .contiguous()),
        position_(positions_.data_ptr<double>()) {
    // Rows of the vertices from each (x, y) on; finer grids search all vertices instead.
    if (grid_.side > kMostIndexedSide) return;
    first_in_line_.assign(static_cast<std::size_t>(grid_.side * grid_.side) + 1, 0);
    for (const std::int64_t number : vertices_) ++first_in_line_[static_cast<std::size_t>(number / grid_.side) + 1];
    std::partial_sum(first_in_line_.begin(), first_in_line_.end(), first_in_line_.begin());
  }

  // Boxes of growing size, until no vertex outside can be nearer: those stand at least radius + 1 cells from the point
  // along some axis, less half a cell that deformation may move them.
  void find(const double* point, NearestList& list) const {
    std::array<std::int64_t, 3> cell{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double place = (point[axis] + 0.5) * static_cast<double>(resolution_);
      cell[axis] = place > 0.0 ? static_cast<std::int64_t>(std::min(place, static_cast<double>(resolution_))) : 0;
    }
    for (std::int64_t radius = 1;; radius *= 2) {
      list.clear();
      scan(point, cell, radius, list);
      const double safe = (static_cast<double>(radius) + 0.5) / static_cast<double>(resolution_);
      if (radius > resolution_ || (list.full() && list.farthest() <= safe * safe)) return;
    }
  }

 private:
  // Range that holds all vertices with these coordinates.
  std::pair<GridSet::const_iterator, GridSet::const_iterator> line_at(std::int64_t x, std::int64_t y) const {
    if (first_in_line_.empty()) return {vertices_.begin(), vertices_.end()};
    const auto line = static_cast<std::size_t>(x * grid_.side + y);
    return {vertices_.begin() + first_in_line_[line], vertices_.begin() + first_in_line_[line + 1]};
  }
  void scan(const double* point, const std::array<std::int64_t, 3>& cell, std::int64_t radius,
            NearestList& list) const {
    const auto low = [&](std::size_t axis) { return std::max<std::int64_t>(0, cell[axis] - radius); };
    const auto high = [&](std::size_t axis) { return std::min(resolution_, cell[axis] + 1 + radius); };
    for (std::int64_t x = low(0); x <= high(0); ++x) {
      for (std::int64_t y = low(1); y <= high(1); ++y) {
        const std::int64_t last = grid_.number(x, y, high(2));
        const auto [line, line_end] = line_at(x, y);
        auto place = std::lower_bound(line, line_end, grid_.number(x, y, low(2)));
        for (; place != line_end && *place <= last; ++place) {
          const std::int64_t row = place - vertices_.begin();
          double squared = 0.0;
          for (std::int64_t axis = 0; axis < 3; ++axis) {
            const double difference = point[axis] - position_[3 * row + axis];
            squared += difference * difference;
          }
          list.offer(squared, row);
        }
      }
    }
  }

  std::int64_t resolution_;
  GridNumbering grid_;
  GridSet vertices_;
  std::vector<std::int64_t> first_in_line_;  // [side² + 1], or empty
  Tensor positions_;
  const double* position_;
};

}  // namespace

bool GridNumbering::is_cube(std::int64_t number) const {
  if (number < 0) return false;
  const auto [x, y, z] = place(number);
  return x < side - 1 && y < side - 1 && z < side - 1;
}

GridSet with_shifted(const GridSet& set, std::int64_t step) {
  GridSet all;
  all.reserve(2 * set.size());
  std::size_t plain = 0, shifted = 0;
  while (plain < set.size() && shifted < set.size()) {
    const std::int64_t a = set[plain], b = set[shifted] + step;
    all.push_back(std::min(a, b));
    if (a <= b) ++plain;
    if (b <= a) ++shifted;
  }
  for (; plain < set.size(); ++plain) all.push_back(set[plain]);
  for (; shifted < set.size(); ++shifted) all.push_back(set[shifted] + step);
  return all;
}

std::vector<std::int32_t> sorting_order(const std::vector<std::int64_t>& numbers) {
  TORCH_CHECK(numbers.size() < static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max()), "too many places");
  std::vector<std::int32_t> order(numbers.size()), next(numbers.size());
  std::iota(order.begin(), order.end(), 0);
  if (std::is_sorted(numbers.begin(), numbers.end())) return order;
  const std::int64_t largest = *std::max_element(numbers.begin(), numbers.end());
  for (int shift = 0; shift < 63 && (largest >> shift) > 0; shift += kDigitBits) {  // radix sort, lowest digit first
    const auto digit = [&](std::int64_t number) { return static_cast<std::size_t>((number >> shift) & kDigitMask); };
    std::vector<std::size_t> first(static_cast<std::size_t>(kDigitMask) + 2, 0);
    for (const std::int64_t number : numbers) ++first[digit(number) + 1];
    std::partial_sum(first.begin(), first.end(), first.begin());
    for (const std::int32_t row : order) next[first[digit(numbers[static_cast<std::size_t>(row)])]++] = row;
    order.swap(next);
  }
  return order;
}

std::vector<std::int64_t> grid_numbers(const Tensor& places, const GridNumbering& grid) {
  const Tensor rows = places.to(torch::kCPU, torch::kInt64).contiguous();
  const std::int64_t* row = rows.data_ptr<std::int64_t>();
  std::vector<std::int64_t> numbers(static_cast<std::size_t>(rows.size(0)));
  for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = grid.number(row[3 * i], row[3 * i + 1], row[3 * i + 2]);
  return numbers;
}

Tensor grid_places(const GridSet& set, const GridNumbering& grid) {
  const auto count = static_cast<std::int64_t>(set.size());
  const Tensor places = torch::empty({count, 3}, torch::kInt32);
  std::int32_t* out = places.data_ptr<std::int32_t>();
  at::parallel_for(0, count, kRowsPerTask, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t i = begin; i < end; ++i) {
      const auto place = grid.place(set[static_cast<std::size_t>(i)]);
      for (int axis = 0; axis < 3; ++axis)
        out[3 * i + axis] = static_cast<std::int32_t>(place[static_cast<std::size_t>(axis)]);
    }
  });
  return places;
}

NearestGridVertices nearest_grid_vertices(const CubeField& field, const Tensor& points, std::int64_t count,
                                          bool deformed) {
  const VertexSearch search(field, deformed);
  const Tensor places = points.detach().to(torch::kCPU, torch::kFloat64).contiguous();
  const NearestGridVertices nearest{torch::zeros({places.size(0), count}, torch::kInt64),
                                    torch::zeros({places.size(0), count}, torch::kFloat64)};
  const double* point = places.data_ptr<double>();
  std::int64_t* rows = nearest.rows.data_ptr<std::int64_t>();
  double* squared = nearest.squared.data_ptr<double>();
  at::parallel_for(0, places.size(0), kPointsPerTask, [&](std::int64_t begin, std::int64_t end) {
    NearestList list(count);
    for (std::int64_t i = begin; i < end; ++i) {
      search.find(point + 3 * i, list);
      std::int64_t entry = i * count;
      for (const auto& [distance, row] : list.entries()) {
        squared[entry] = distance;
        rows[entry++] = row;
      }
    }
  });
  return nearest;
}

}  // namespace anigen::shape_field
