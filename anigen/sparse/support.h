#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "anigen/nn/host_tensor.h"
#include "anigen/nn/ragged_attention.h"
#include "anigen/nn/torch.h"

namespace anigen::sparse {

using torch::Tensor;

/// Rows by ascending key, rows of equal keys in their order.
struct SortedKeys {
  std::vector<std::uint64_t> keys;
  std::vector<std::int32_t> rows;
};

/// A radix sort: linear in the number of keys, and it skips digits that all keys share. @param keys of rows 0, 1, …
SortedKeys sort_keys(std::vector<std::uint64_t> keys);

/// Number of voxels along each axis that make one voxel of a coarser grid.
struct GridFactor {
  GridFactor(std::int64_t all_axes) : axes{all_axes, all_axes, all_axes} {}  // one number stands for three
  GridFactor(std::int64_t x, std::int64_t y, std::int64_t z) : axes{x, y, z} {}
  bool operator<(const GridFactor& other) const { return axes < other.axes; }

  std::array<std::int64_t, 3> axes;  ///< x, y, z
};

/// The rows of each item sorted by their voxels x, y, z divided by `divisor`. A voxel's key is
/// (x + 1) · stride_x + (y + 1) · stride_y + z + 1, with strides large enough that the keys of its neighbours follow by
/// adding ± stride_x ± stride_y ± 1, also across the border of the grid.
struct VoxelOrder {
  std::uint64_t stride_x = 0, stride_y = 0;
  std::vector<std::uint64_t> keys;  ///< [N]; ascending within an item
  std::vector<std::int32_t> rows;   ///< [N]; of the support, in the order of keys
};

/// @param coords [N, 4] int32, CPU, contiguous, each below 2^20 @param items rows of each item
VoxelOrder voxel_order(const Tensor& coords, const nn::Ragged& items, const GridFactor& divisor);

/// Largest x, y, z, or 0 each without rows. @param coords as above
std::vector<std::int64_t> largest_coordinates(const Tensor& coords);

class Support;
using SupportPtr = std::shared_ptr<const Support>;

/// Rows of a support sorted into groups that attend to each other (windows, or whole items).
struct WindowOrder {
  nn::HostTensor order;      ///< [N] int64: row at each place of the grouped order; ascending inside a window
  nn::HostTensor place;      ///< [N] int64: inverse of order
  Tensor offsets;            ///< [W + 1] int64, CPU: places where windows begin; no window is empty
  Tensor windows;            ///< [W] int64, CPU, ascending: number of the window as published (see Support::windows)
  std::int64_t longest = 0;  ///< rows of the largest window
};

/// A coarser support and the way to it.
struct Coarsening {
  SupportPtr support;    ///< rows sorted by item, x, y, z
  nn::HostTensor row;    ///< [N] int64: coarse row of each fine row
  nn::HostTensor count;  ///< [coarse N] int64: fine rows of each coarse row, at least 1
};

/// Set of voxels: the places of a SparseTensor, immutable and shared by every tensor with a feature row per place.
/// Whatever layers derive from the places (neighbours, windows, the subdivided or coarser support) is worked out at the
/// first use, by one thread, and kept: all layers of a network on the same support share it. Thread-safe.
class Support : public std::enable_shared_from_this<Support> {
 public:
  /// @param coords [N, 4] integers: item in the batch, x, y, z; rows of an item contiguous, items ascending, x, y, z in
  /// [0, 2^20); any order of rows inside an item, which every layer keeps @param items number of items, for batches
  /// whose last items are empty; 0: one more than the last row's
  /// @throws InputError naming the row: wrong shape or type, items not ascending or more than 2^20, a coordinate out of
  /// range, a voxel twice
  static SupportPtr create(const Tensor& coords, std::int64_t items = 0);

  const Tensor& coords() const;  ///< [N, 4] int32, CPU, contiguous
  /// x, y, z of the voxels: [N, 3] int32, kept on the device that asked last.
  Tensor places_on(torch::Device device) const;
  std::int64_t size() const;        ///< N
  const nn::Ragged& items() const;  ///< rows of each item
  /// Centres (c + 0.5)/R − 0.5 of the voxels. @return [N, 3] fp32 (docs/reference/autoencoders.md, 1.1)
  Tensor centers(std::int64_t resolution) const;

  /// Row of each of the 27 neighbours c + (i−1, j−1, k−1), tap (i·3 + j)·3 + k; −1 where there is none. [27, N] int32
  const Tensor& neighbours() const;
  /// As above, kept on the device that asked last.
  Tensor neighbours_on(torch::Device device) const;
  /// Rows by windows of `size`³ voxels: the window of a row is (item, ⌊(c + shift)/size⌋)
  /// (docs/reference/autoencoders.md, 1.2). With n = ⌈(largest c + shift + 1)/size⌉ windows along an axis, over all
  /// items of this support, it has the published number ((item · n_x + w_x) · n_y + w_y) · n_z + w_z. Windowed cross
  /// attention lets a window of the queries see the window of the keys with the same number, whatever places both have:
  /// supports with different n pair unrelated windows, as published (reference parity README on
  /// `ops_window_attention`).
  /// @throws InputError for a size below 1, a shift below 0 or above 2^20, or numbers beyond 2^62
  const WindowOrder& windows(std::int64_t size, std::int64_t shift) const;
  /// Every voxel c becomes the eight 2c + (i, j, k), consecutive, z fastest (docs/reference/autoencoders.md, 4.6).
  /// @throws InputError when a coordinate would leave [0, 2^20), or rows would exceed 2^31
  SupportPtr subdivided() const;
  /// Places of c / factor (integer division along each axis). @throws InputError for a factor below 1
  const Coarsening& coarsened(const GridFactor& factor) const;

 private:
  struct Derived;
  struct Key {};

 public:
  Support(Key, Tensor coords, nn::Ragged items);  ///< use create()
  ~Support();

 private:
  Tensor coords_;
  nn::Ragged items_;
  std::unique_ptr<Derived> derived_;
};

/// Features at the places of a support, one row per voxel (docs/reference/autoencoders.md, 1.1). Copies are shallow.
struct SparseTensor {
  SupportPtr support;
  Tensor feats;  ///< [N, C]

  /// Other features at the same places. @param rows [N, C']
  SparseTensor with(Tensor rows) const { return {support, std::move(rows)}; }
  std::int64_t channels() const { return feats.size(1); }
};

}  // namespace anigen::sparse
