#pragma once
#include <ATen/Parallel.h>

#include <algorithm>
#include <cstdint>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::nn {

/// Some rows of one item, what a thread does at a time.
struct RowBlock {
  std::int64_t item, first, count;
};

/// All rows in order, in blocks of about as many numbers each. They depend on sizes alone, so that sums over rows are
/// the same for any number of threads.
inline std::vector<RowBlock> row_blocks(const std::vector<std::int64_t>& lengths, std::int64_t channels) {
  constexpr std::int64_t kNumbers = 32768;
  const std::int64_t most = std::max<std::int64_t>(16, kNumbers / std::max<std::int64_t>(1, channels));
  std::vector<RowBlock> blocks;
  std::int64_t row = 0;
  for (std::size_t i = 0; i < lengths.size(); ++i) {
    for (const std::int64_t end = row + lengths[i]; row < end; row += blocks.back().count) {
      blocks.push_back({static_cast<std::int64_t>(i), row, std::min(most, end - row)});
    }
  }
  return blocks;
}

/// Calls body(block, number of the block) for all, by all threads.
template <typename Body>
void for_each_block(const std::vector<RowBlock>& blocks, const Body& body) {
  at::parallel_for(0, static_cast<std::int64_t>(blocks.size()), 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t b = begin; b < end; ++b) body(blocks[static_cast<std::size_t>(b)], b);
  });
}

/// A sum per block [blocks, C] added up per item, in the order of the blocks. @return [items, C] fp32
inline torch::Tensor sums_of_items(const std::vector<RowBlock>& blocks, const torch::Tensor& parts,
                                   std::int64_t items) {
  const std::int64_t channels = parts.size(1);
  const torch::Tensor sums = torch::zeros({items, channels}, parts.options());
  const float* part = parts.data_ptr<float>();
  for (const RowBlock& block : blocks) {
    float* const sum = sums.data_ptr<float>() + block.item * channels;
    for (std::int64_t c = 0; c < channels; ++c) sum[c] += part[c];
    part += channels;
  }
  return sums;
}

}  // namespace anigen::nn
