#pragma once
#include <cstddef>
#include <cstdint>

#include "anigen/nn/host_tensor.h"
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// Window of the self attention of flows on this thread, while one lives: tokens on a grid see those of their window of
/// `size`³ places alone. Windows are shifted by half of that in every second block (Liu et al. 2021, Swin). For the
/// first steps of a sampling, whose state is mostly noise: attention over N places costs N · size³ instead of N².
class AttentionWindows {
 public:
  /// @param size 0: attention is full, also where another one lives
  explicit AttentionWindows(std::int64_t size);
  ~AttentionWindows();
  AttentionWindows(const AttentionWindows&) = delete;
  AttentionWindows& operator=(const AttentionWindows&) = delete;

  /// Edge of the windows on this thread; 0: attention is full.
  static std::int64_t size();
  /// Shift of block i on this thread: 0 for even ones, half an edge for odd ones.
  static std::int64_t shift(std::size_t block) { return block % 2 == 0 ? 0 : size() / 2; }

 private:
  std::int64_t outer_;  // size of what lived on this thread before
};

/// Windows of the tokens of a grid: the window of a place c is ⌊(c + shift) / size⌋ along each axis.
struct GridWindows {
  std::int64_t side = 0;   ///< places along an axis; tokens in the order of grid_coordinates()
  std::int64_t size = 0;   ///< 0: attention is full
  std::int64_t shift = 0;  ///< below size

  /// True unless one window holds the whole grid.
  bool divide() const { return size > 0 && side + shift > size; }
};

/// Tokens of a grid by windows.
struct TokenOrder {
  HostTensor order;   ///< [side³] int64: token at each place of the order
  HostTensor places;  ///< [side³] int64: place of each token
  Tensor offsets;     ///< [W + 1] int64, CPU: places where windows begin
};
/// Worked out once per thread, for the last few windows that were asked for: lists go to a device once.
TokenOrder token_order(const GridWindows& windows);

}  // namespace anigen::nn
