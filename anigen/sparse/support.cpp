#include "anigen/sparse/support.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <map>
#include <mutex>
#include <numeric>
#include <optional>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/nn/init.h"
#include "anigen/sparse/windows.h"

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

constexpr std::int64_t kGridSize = std::int64_t{1} << 20;
constexpr std::int64_t kMostItems = std::int64_t{1} << 20;
constexpr std::int64_t kMostRows = std::numeric_limits<std::int32_t>::max();

[[noreturn]] void fail_support(const std::string& place, const std::string& problem) {
  throw InputError("", place, "voxels: " + problem);
}

std::string row_text(std::int64_t row) { return "row " + std::to_string(row); }

std::string voxel_text(const std::int32_t* c) {
  return "(" + std::to_string(c[1]) + ", " + std::to_string(c[2]) + ", " + std::to_string(c[3]) + ") of item " +
         std::to_string(c[0]);
}

Tensor checked_rows(const Tensor& coords) {
  if (!coords.defined() || coords.dim() != 2 || coords.size(1) != 4 || coords.size(0) > kMostRows ||
      !c10::isIntegralType(coords.scalar_type(), /*includeBool=*/false)) {
    fail_support("", "integers of the shape [N, 4] are needed (item, x, y, z), found " + nn::shape_text(coords) +
                         (coords.defined() ? std::string(" of type ") + c10::toString(coords.scalar_type()) : ""));
  }
  return coords.detach().to(torch::kCPU).to(torch::kInt64).contiguous();
}

// Rows of each item. @param rows [N, 4] int64
std::vector<std::int64_t> item_lengths(const Tensor& rows, std::int64_t items) {
  if (items < 0 || items > kMostItems) fail_support("", std::to_string(items) + " items; from 0 to 2^20 can be");
  std::vector<std::int64_t> lengths(static_cast<std::size_t>(items), 0);
  const std::int64_t most = items > 0 ? items : kMostItems;
  const auto* c = rows.data_ptr<std::int64_t>();
  for (std::int64_t row = 0, last = 0; row < rows.size(0); ++row, c += 4) {
    if (c[0] < last) {
      fail_support(row_text(row), "item " + std::to_string(c[0]) + " after item " + std::to_string(last) +
                                      "; items must ascend from 0 on");
    }
    if (c[0] >= most)
      fail_support(row_text(row), "item " + std::to_string(c[0]) + "; there are at most " + std::to_string(most));
    for (int axis = 1; axis < 4; ++axis) {
      if (c[axis] >= 0 && c[axis] < kGridSize) continue;
      fail_support(row_text(row), "coordinate " + std::to_string(c[axis]) + " is not in [0, 2^20)");
    }
    last = c[0];
    if (last >= static_cast<std::int64_t>(lengths.size())) lengths.resize(static_cast<std::size_t>(last) + 1, 0);
    ++lengths[static_cast<std::size_t>(last)];
  }
  return lengths;
}

void require_distinct(const VoxelOrder& order, const Tensor& coords, const nn::Ragged& items) {
  for (std::int64_t item = 0; item < items.items(); ++item) {
    const auto first = static_cast<std::size_t>(items.offset(item));
    const auto count = static_cast<std::size_t>(items.lengths()[static_cast<std::size_t>(item)]);
    for (std::size_t i = first + 1; i < first + count; ++i) {
      if (order.keys[i] != order.keys[i - 1]) continue;
      const std::int32_t* const c = coords.data_ptr<std::int32_t>() + 4 * static_cast<std::int64_t>(order.rows[i]);
      fail_support(row_text(order.rows[i]), voxel_text(c) + " is also " + row_text(order.rows[i - 1]));
    }
  }
}

std::vector<std::int64_t> eightfold(std::vector<std::int64_t> lengths) {
  for (std::int64_t& length : lengths) length *= 8;
  return lengths;
}

Tensor children_of(const Tensor& coords) {
  std::vector<std::int32_t> offsets;
  for (std::int32_t child = 0; child < 8; ++child) {
    offsets.insert(offsets.end(), {0, child / 4, child / 2 % 2, child % 2});
  }
  const auto options = torch::TensorOptions().dtype(torch::kInt32);
  const Tensor scale = torch::tensor(std::vector<std::int32_t>{1, 2, 2, 2}, options);
  const Tensor children = (coords * scale).unsqueeze(1) + torch::tensor(offsets, options).view({1, 8, 4});
  return children.reshape({8 * coords.size(0), 4}).contiguous();
}

// Coarse voxels and which one each row falls into: Support::coarsened, without a support.
struct CoarseRows {
  Tensor coords;                      // [M, 4] int32
  Tensor row, count;                  // as in Coarsening, on the host
  std::vector<std::int64_t> lengths;  // coarse rows of each item
};

CoarseRows coarse_rows(const Tensor& coords, const nn::Ragged& items, const GridFactor& factor) {
  const VoxelOrder order = voxel_order(coords, items, factor);
  CoarseRows coarse;
  coarse.row = torch::empty({coords.size(0)}, torch::kInt64);
  auto* row_of = coarse.row.data_ptr<std::int64_t>();
  const std::int32_t* const fine = coords.data_ptr<std::int32_t>();
  std::vector<std::int32_t> places;
  std::vector<std::int64_t> counts;
  for (std::int64_t item = 0; item < items.items(); ++item) {
    const std::size_t before = counts.size();
    const std::int64_t first = items.offset(item);
    const std::int64_t last = first + items.lengths()[static_cast<std::size_t>(item)];
    for (std::int64_t i = first; i < last; ++i) {
      const auto at = static_cast<std::size_t>(i);
      if (i == first || order.keys[at] != order.keys[at - 1]) {
        const std::int32_t* const c = fine + std::ptrdiff_t{4} * order.rows[at];
        places.push_back(c[0]);
        for (std::size_t axis = 0; axis < 3; ++axis)
          places.push_back(static_cast<std::int32_t>(c[axis + 1] / factor.axes[axis]));
        counts.push_back(0);
      }
      ++counts.back();
      row_of[order.rows[at]] = static_cast<std::int64_t>(counts.size()) - 1;
    }
    coarse.lengths.push_back(static_cast<std::int64_t>(counts.size() - before));
  }
  const auto rows = static_cast<std::int64_t>(counts.size());
  coarse.coords = torch::tensor(places, torch::TensorOptions().dtype(torch::kInt32)).view({rows, 4});
  coarse.count = torch::tensor(counts, torch::TensorOptions().dtype(torch::kInt64));
  return coarse;
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

// Results computed so far. The mutex is held meanwhile: other threads wait for the result instead of repeating
// the work.
struct Support::Derived {
  std::mutex mutex;
  std::optional<VoxelOrder> order;  // of the check for equal voxels, until the neighbours are known
  nn::HostTensor neighbours, places;
  std::map<std::pair<std::int64_t, std::int64_t>, WindowOrder> windows;  // by size and shift
  SupportPtr subdivided;
  std::map<GridFactor, Coarsening> coarsened;  // by factor

  const nn::HostTensor& neighbours_of(const Support& support) {
    if (neighbours.defined()) return neighbours;
    if (!order) order = voxel_order(support.coords_, support.items_, 1);
    neighbours = nn::HostTensor(neighbour_map(*order, support.items_));
    order.reset();
    return neighbours;
  }
};

Support::Support(Key, Tensor coords, nn::Ragged items)
    : coords_(std::move(coords)), items_(std::move(items)), derived_(std::make_unique<Derived>()) {}

Support::~Support() = default;

SupportPtr Support::create(const Tensor& coords, std::int64_t items) {
  const Tensor rows = checked_rows(coords);
  auto support = std::make_shared<Support>(Key{}, Tensor(), nn::Ragged(item_lengths(rows, items)));
  support->coords_ = rows.to(torch::kInt32);
  VoxelOrder order = voxel_order(support->coords_, support->items_, 1);
  require_distinct(order, support->coords_, support->items_);
  support->derived_->order = std::move(order);
  return support;
}

const Tensor& Support::coords() const { return coords_; }
std::int64_t Support::size() const { return coords_.size(0); }
const nn::Ragged& Support::items() const { return items_; }

Tensor Support::places_on(torch::Device device) const {
  const std::lock_guard<std::mutex> lock(derived_->mutex);
  if (!derived_->places.defined()) derived_->places = nn::HostTensor(coords_.slice(1, 1).contiguous());
  return derived_->places.on(device);
}

Tensor Support::centers(std::int64_t resolution) const {
  return (coords_.slice(1, 1).to(torch::kFloat32) + 0.5) / static_cast<double>(resolution) - 0.5;
}

const Tensor& Support::neighbours() const {
  const std::lock_guard<std::mutex> lock(derived_->mutex);
  return derived_->neighbours_of(*this).host();
}

Tensor Support::neighbours_on(torch::Device device) const {
  const std::lock_guard<std::mutex> lock(derived_->mutex);
  return derived_->neighbours_of(*this).on(device);
}

const WindowOrder& Support::windows(std::int64_t size, std::int64_t shift) const {
  const std::lock_guard<std::mutex> lock(derived_->mutex);
  const std::pair key(size, shift);
  const auto found = derived_->windows.find(key);
  if (found != derived_->windows.end()) return found->second;
  return derived_->windows.emplace(key, window_order(coords_, items_.items(), size, shift)).first->second;
}

SupportPtr Support::subdivided() const {
  const std::lock_guard<std::mutex> lock(derived_->mutex);
  if (derived_->subdivided) return derived_->subdivided;
  for (const std::int64_t largest : largest_coordinates(coords_)) {
    if (2 * largest + 1 < kGridSize && size() <= kMostRows / 8) continue;
    fail_support("", "dividing " + std::to_string(size()) + " voxels up to coordinate " + std::to_string(largest) +
                         " would exceed 2^31 rows or coordinate 2^20");
  }
  derived_->subdivided =
      std::make_shared<Support>(Key{}, children_of(coords_), nn::Ragged(eightfold(items_.lengths())));
  return derived_->subdivided;
}

const Coarsening& Support::coarsened(const GridFactor& factor) const {
  const std::lock_guard<std::mutex> lock(derived_->mutex);
  const auto found = derived_->coarsened.find(factor);
  if (found != derived_->coarsened.end()) return found->second;
  for (const std::int64_t along_axis : factor.axes) {
    if (along_axis >= 1) continue;
    fail_support("", "coarser by a factor of " + std::to_string(along_axis) + "; it must be at least 1");
  }
  CoarseRows rows = coarse_rows(coords_, items_, factor);
  Coarsening coarsening;
  coarsening.support = std::make_shared<Support>(Key{}, std::move(rows.coords), nn::Ragged(std::move(rows.lengths)));
  coarsening.row = nn::HostTensor(rows.row);
  coarsening.count = nn::HostTensor(rows.count);
  return derived_->coarsened.emplace(factor, std::move(coarsening)).first->second;
}

}  // namespace anigen::sparse
