#include "anigen/fields/grid_sets.h"

#include <limits>
#include <numeric>

namespace anigen::fields {
namespace {

constexpr int kDigitBits = 11;
constexpr std::int64_t kDigitMask = (1 << kDigitBits) - 1;
constexpr std::int64_t kRowsPerTask = 1 << 14;

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
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    numbers[i] = grid.number(row[3 * i], row[3 * i + 1], row[3 * i + 2]);
  }
  return numbers;
}

Tensor grid_places(const GridSet& set, const GridNumbering& grid) {
  const auto count = static_cast<std::int64_t>(set.size());
  const Tensor places = torch::empty({count, 3}, torch::kInt32);
  std::int32_t* out = places.data_ptr<std::int32_t>();
  at::parallel_for(0, count, kRowsPerTask, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t i = begin; i < end; ++i) {
      const auto place = grid.place(set[static_cast<std::size_t>(i)]);
      for (int axis = 0; axis < 3; ++axis) {
        out[3 * i + axis] = static_cast<std::int32_t>(place[static_cast<std::size_t>(axis)]);
      }
    }
  });
  return places;
}

}  // namespace anigen::fields
