#include "anigen/sparse/voxel_order.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <utility>

namespace anigen::sparse {
namespace {

constexpr int kDigitBits = 11;
constexpr std::size_t kDigits = std::size_t{1} << kDigitBits;

std::size_t digit_of(std::uint64_t key, int shift) { return static_cast<std::size_t>(key >> shift) & (kDigits - 1); }

// One pass: `to` is `from` ordered by the digit at `shift`, equal digits in their order. Nothing when all are equal.
bool sort_by_digit(const SortedKeys& from, SortedKeys& to, int shift) {
  std::array<std::size_t, kDigits> begin{};
  for (const std::uint64_t key : from.keys) ++begin[digit_of(key, shift)];
  if (begin[digit_of(from.keys.front(), shift)] == from.keys.size()) return false;
  std::size_t sum = 0;
  for (std::size_t& count : begin) sum += std::exchange(count, sum);
  for (std::size_t i = 0; i < from.keys.size(); ++i) {
    const std::size_t place = begin[digit_of(from.keys[i], shift)]++;
    to.keys[place] = from.keys[i];
    to.rows[place] = from.rows[i];
  }
  return true;
}

}  // namespace

SortedKeys sort_keys(std::vector<std::uint64_t> keys) {
  SortedKeys sorted;
  sorted.rows.resize(keys.size());
  std::iota(sorted.rows.begin(), sorted.rows.end(), 0);
  sorted.keys = std::move(keys);
  if (std::is_sorted(sorted.keys.begin(), sorted.keys.end())) return sorted;
  SortedKeys other;
  other.keys.resize(sorted.keys.size());
  other.rows.resize(sorted.keys.size());
  const std::uint64_t largest = *std::max_element(sorted.keys.begin(), sorted.keys.end());
  for (int shift = 0; shift < 64 && (largest >> shift) > 0; shift += kDigitBits) {
    if (sort_by_digit(sorted, other, shift)) std::swap(sorted, other);
  }
  return sorted;
}

std::vector<std::int64_t> largest_coordinates(const Tensor& coords) {
  std::vector<std::int64_t> largest(3, 0);
  const std::int32_t* c = coords.data_ptr<std::int32_t>();
  for (std::int64_t row = 0; row < coords.size(0); ++row, c += 4) {
    for (std::size_t axis = 0; axis < 3; ++axis) largest[axis] = std::max<std::int64_t>(largest[axis], c[axis + 1]);
  }
  return largest;
}

VoxelOrder voxel_order(const Tensor& coords, const nn::Ragged& items, const GridFactor& divisor) {
  const std::vector<std::int64_t> largest = largest_coordinates(coords);
  VoxelOrder order;
  order.stride_y = static_cast<std::uint64_t>(largest[2] / divisor.axes[2] + 3);  // a free place on either side
  order.stride_x = order.stride_y * static_cast<std::uint64_t>(largest[1] / divisor.axes[1] + 3);
  order.keys.reserve(static_cast<std::size_t>(coords.size(0)));
  order.rows.reserve(static_cast<std::size_t>(coords.size(0)));
  const std::int32_t* c = coords.data_ptr<std::int32_t>();
  const auto place = [&](std::size_t axis) { return static_cast<std::uint64_t>(c[axis + 1] / divisor.axes[axis] + 1); };
  for (std::int64_t item = 0; item < items.items(); ++item) {
    std::vector<std::uint64_t> keys(static_cast<std::size_t>(items.lengths()[static_cast<std::size_t>(item)]));
    for (std::uint64_t& key : keys) {
      key = place(0) * order.stride_x + place(1) * order.stride_y + place(2);
      c += 4;
    }
    const SortedKeys sorted = sort_keys(std::move(keys));
    order.keys.insert(order.keys.end(), sorted.keys.begin(), sorted.keys.end());
    const auto offset = static_cast<std::int32_t>(items.offset(item));
    for (const std::int32_t row : sorted.rows) order.rows.push_back(offset + row);
  }
  return order;
}

}  // namespace anigen::sparse
