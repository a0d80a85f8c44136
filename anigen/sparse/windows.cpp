#include "anigen/sparse/windows.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"

namespace anigen::sparse {

namespace {

// Strides of the published numbers: of an item, and of a step along x, y and z.
struct WindowStrides {
  std::uint64_t item, x, y;
};

WindowStrides window_strides(const Tensor& coords, std::int64_t items, std::int64_t size, std::int64_t shift) {
  constexpr std::uint64_t kMostWindows = std::uint64_t{1} << 62;
  const std::vector<std::int64_t> largest = largest_coordinates(coords);
  const auto windows = [&](std::size_t axis) { return static_cast<std::uint64_t>((largest[axis] + shift) / size + 1); };
  WindowStrides strides{1, 1, 1};
  std::uint64_t product = 1;
  const auto extend = [&](std::uint64_t count) {
    if (count > 0 && product > kMostWindows / count)
      throw InputError("", "", "windows of " + std::to_string(size) + " voxels: their numbers would exceed 2^62");
    return product *= count;
  };
  strides.y = extend(windows(2));
  strides.x = extend(windows(1));
  strides.item = extend(windows(0));
  extend(static_cast<std::uint64_t>(items));
  return strides;
}

Tensor int64_tensor(const std::vector<std::int64_t>& values) {
  return torch::tensor(values, torch::TensorOptions().dtype(torch::kInt64));
}

class PermuteRows : public torch::autograd::Function<PermuteRows> {
 public:
  static Tensor forward(torch::autograd::AutogradContext* context, const Tensor& rows, const Tensor& order,
                        const Tensor& inverse) {
    context->save_for_backward({inverse});
    return rows.index_select(0, order);
  }
  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list gradients) {
    return {gradients[0].index_select(0, context->get_saved_variables()[0]), Tensor(), Tensor()};
  }
};

Tensor permute_rows(const Tensor& rows, const nn::HostTensor& order, const nn::HostTensor& inverse) {
  return PermuteRows::apply(rows, order.on(rows.device()), inverse.on(rows.device()));
}

// Windows one after another, by ascending number.
class WindowCursor {
 public:
  explicit WindowCursor(const WindowOrder& windows)
      : numbers_(windows.windows.data_ptr<std::int64_t>()),
        offsets_(windows.offsets.data_ptr<std::int64_t>()),
        count_(windows.windows.size(0)) {
    for (std::int64_t w = 1; w < count_; ++w)
      TORCH_CHECK(numbers_[w - 1] < numbers_[w], "windows must be in the order of their numbers");
  }
  std::int64_t number() const { return at_ < count_ ? numbers_[at_] : std::numeric_limits<std::int64_t>::max(); }
  bool done() const { return at_ == count_; }
  // Steps over this window if it has that number. @return the row behind it
  std::int64_t end_of(std::int64_t number) {
    if (!done() && numbers_[at_] == number) ++at_;
    return offsets_[at_];
  }

 private:
  const std::int64_t *numbers_, *offsets_;
  std::int64_t count_, at_ = 0;
};

constexpr std::int64_t kRowsPerThread = 4096;

// The sorted voxels of one item.
struct SortedItem {
  const std::uint64_t* keys;
  const std::int32_t* rows;
  std::int64_t count;
};

// Neighbours along z of one column of neighbours for the places begin … end: keys ascend together with those looked
// for, so that one walk along them finds all. @param map of the first of the three taps, taps `rows_in_all` apart
void find_column(const SortedItem& item, std::int64_t begin, std::int64_t end, std::uint64_t offset, std::int32_t* map,
                 std::int64_t rows_in_all) {
  const std::uint64_t* const last = item.keys + item.count;
  const std::uint64_t* at = std::lower_bound(item.keys, last, item.keys[begin] + offset - 1);
  for (std::int64_t place = begin; place < end; ++place) {
    const std::uint64_t below = item.keys[place] + offset - 1;
    while (at != last && *at < below) ++at;
    const std::uint64_t* found = at;
    for (std::uint64_t dz = 0; dz < 3; ++dz) {
      if (found == last || *found != below + dz) continue;
      map[static_cast<std::int64_t>(dz) * rows_in_all + item.rows[place]] = item.rows[found - item.keys];
      ++found;
    }
  }
}

}  // namespace

WindowOrder window_order(const Tensor& coords, std::int64_t items, std::int64_t size, std::int64_t shift) {
  constexpr std::int64_t kLargestShift = std::int64_t{1} << 20;  // of a window: also the largest sensible size
  if (size < 1 || shift < 0 || shift > kLargestShift) {
    throw InputError("", "",
                     "windows of " + std::to_string(size) + " voxels shifted by " + std::to_string(shift) +
                         ": the size must be at least 1, the shift from 0 to 2^20");
  }
  const WindowStrides strides = window_strides(coords, items, size, shift);
  const std::int64_t rows = coords.size(0);
  const std::int32_t* c = coords.data_ptr<std::int32_t>();
  const auto along = [=](std::int32_t coordinate) { return static_cast<std::uint64_t>((coordinate + shift) / size); };
  std::vector<std::uint64_t> numbers(static_cast<std::size_t>(rows));
  for (std::uint64_t& number : numbers) {
    number = static_cast<std::uint64_t>(c[0]) * strides.item + along(c[1]) * strides.x + along(c[2]) * strides.y +
             along(c[3]);
    c += 4;
  }
  const SortedKeys sorted = sort_keys(std::move(numbers));

  WindowOrder windows;
  const Tensor order_list = torch::empty({rows}, torch::kInt64), place_list = torch::empty_like(order_list);
  auto* order = order_list.data_ptr<std::int64_t>();
  auto* place = place_list.data_ptr<std::int64_t>();
  std::vector<std::int64_t> offsets, found;
  for (std::int64_t i = 0; i < rows; ++i) {
    const auto at = static_cast<std::size_t>(i);
    order[i] = sorted.rows[at];
    place[sorted.rows[at]] = i;
    if (i > 0 && sorted.keys[at] == sorted.keys[at - 1]) continue;
    offsets.push_back(i);
    found.push_back(static_cast<std::int64_t>(sorted.keys[at]));
  }
  offsets.push_back(rows);
  for (std::size_t w = 0; w < found.size(); ++w)
    windows.longest = std::max(windows.longest, offsets[w + 1] - offsets[w]);
  windows.order = nn::HostTensor(order_list);
  windows.place = nn::HostTensor(place_list);
  windows.offsets = int64_tensor(offsets);
  windows.windows = int64_tensor(found);
  return windows;
}

Tensor to_window_order(const Tensor& rows, const WindowOrder& windows) {
  return permute_rows(rows, windows.order, windows.place);
}

Tensor from_window_order(const Tensor& rows, const WindowOrder& windows) {
  return permute_rows(rows, windows.place, windows.order);
}

PairedOffsets pair_windows(const WindowOrder& queries, const WindowOrder& keys) {
  WindowCursor query(queries), key(keys);
  std::vector<std::int64_t> q_offsets{0}, k_offsets{0};
  while (!query.done() || !key.done()) {
    const std::int64_t number = query.number() < key.number() ? query.number() : key.number();
    q_offsets.push_back(query.end_of(number));
    k_offsets.push_back(key.end_of(number));
  }
  return {int64_tensor(q_offsets), int64_tensor(k_offsets)};
}

Tensor neighbour_map(const VoxelOrder& order, const nn::Ragged& items) {
  const std::int64_t rows = items.rows();
  const Tensor map = torch::full({27, rows}, -1, torch::kInt32);
  std::int32_t* const entries = map.data_ptr<std::int32_t>();
  for (std::int64_t i = 0; i < items.items(); ++i) {
    const SortedItem item{order.keys.data() + items.offset(i), order.rows.data() + items.offset(i),
                          items.lengths()[static_cast<std::size_t>(i)]};
    at::parallel_for(0, item.count, kRowsPerThread, [&](std::int64_t begin, std::int64_t end) {
      for (std::int64_t column = 0; column < 9; ++column) {
        // Unsigned: a step down is added modulo 2^64. Keys are above both strides and one, so no sum is negative.
        const std::uint64_t offset = (static_cast<std::uint64_t>(column / 3) - 1) * order.stride_x +
                                     (static_cast<std::uint64_t>(column % 3) - 1) * order.stride_y;
        find_column(item, begin, end, offset, entries + 3 * column * rows, rows);
      }
    });
  }
  return map;
}

}  // namespace anigen::sparse
