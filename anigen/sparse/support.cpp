#include "anigen/sparse/support.h"

#include <limits>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/shape_text.h"
#include "anigen/sparse/coarsening.h"
#include "anigen/sparse/neighbour_map.h"
#include "anigen/sparse/voxel_order.h"
#include "anigen/sparse/window_order.h"

namespace anigen::sparse {
namespace {

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
    if (c[0] >= most) {
      fail_support(row_text(row), "item " + std::to_string(c[0]) + "; there are at most " + std::to_string(most));
    }
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

}  // namespace

// What has been worked out so far. The mutex is held meanwhile: other threads wait for the result instead of repeating
// the work.
struct Support::Derived {
  std::mutex mutex;
  std::optional<VoxelOrder> order;  // of the check for equal voxels, until the neighbours are known
  Tensor neighbours, neighbours_elsewhere;
  std::map<std::pair<std::int64_t, std::int64_t>, WindowOrder> windows;  // by size and shift
  SupportPtr subdivided;
  std::map<GridFactor, Coarsening> coarsened;  // by factor

  const Tensor& neighbours_of(const Support& support) {
    if (neighbours.defined()) return neighbours;
    if (!order) order = voxel_order(support.coords_, support.items_, 1);
    neighbours = neighbour_map(*order, support.items_);
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

Tensor Support::centers(std::int64_t resolution) const {
  return (coords_.slice(1, 1).to(torch::kFloat32) + 0.5) / static_cast<double>(resolution) - 0.5;
}

const Tensor& Support::neighbours() const {
  const std::lock_guard<std::mutex> lock(derived_->mutex);
  return derived_->neighbours_of(*this);
}

Tensor Support::neighbours_on(torch::Device device) const {
  const std::lock_guard<std::mutex> lock(derived_->mutex);
  const Tensor& here = derived_->neighbours_of(*this);
  if (device.is_cpu()) return here;
  Tensor& there = derived_->neighbours_elsewhere;
  if (!there.defined() || there.device() != device) there = here.to(device);
  return there;
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
  coarsening.row = std::move(rows.row);
  coarsening.count = std::move(rows.count);
  return derived_->coarsened.emplace(factor, std::move(coarsening)).first->second;
}

}  // namespace anigen::sparse
