#pragma once
#include <cstdint>

namespace anigen::nn {

/// Floating-point operations of a pass, a multiplication and an addition counting as two. Norms, activations,
/// softmax and residual sums are left out: they are a few operations per value.
struct FlopCount {
  double linear = 0.0;       ///< 2 · rows · in · out per linear layer
  double attention = 0.0;    ///< 2 · 2 · N · M · C per attention: scores, and weighted sum of values
  double convolution = 0.0;  ///< 2 · P · in · out per sparse convolution, P pairs of a voxel and a neighbour or itself
  double total() const { return linear + attention + convolution; }
  FlopCount& operator+=(const FlopCount& more) {
    linear += more.linear;
    attention += more.attention;
    convolution += more.convolution;
    return *this;
  }
};

/// Of a linear layer with a low-rank addition.
inline double linear_flops(double rows, double in, double out, double rank = 0.0) {
  return 2.0 * rows * in * out + 2.0 * rows * rank * (in + out);
}

/// Sizes of a transformer block with self and cross attention, over all items of a batch.
struct CrossBlockSize {
  double items = 1.0;
  double tokens = 0.0, channels = 0.0;
  double context_tokens = 0.0, context_channels = 0.0;
  double attended = 0.0;  ///< Σ n (n + m) over items with n tokens and m context tokens
  double hidden = 0.0;    ///< channels inside the MLP
  bool own_modulation = true;
  double self_rank = 0.0, cross_rank = 0.0;  ///< of low-rank additions to the projections
};

inline FlopCount cross_block_flops(const CrossBlockSize& s) {
  const double n = s.tokens, c = s.channels;
  FlopCount count;
  count.linear += linear_flops(n, c, 3.0 * c, s.self_rank) + linear_flops(n, c, c, s.self_rank);
  count.linear += linear_flops(n, c, c, s.cross_rank) +
                  linear_flops(s.context_tokens, s.context_channels, 2.0 * c, s.cross_rank) +
                  linear_flops(n, c, c, s.cross_rank);
  count.linear += linear_flops(n, c, s.hidden) + linear_flops(n, s.hidden, c);
  if (s.own_modulation) count.linear += linear_flops(s.items, c, 6.0 * c);
  count.attention = 4.0 * s.attended * c;
  return count;
}

/// Width inside an MLP, as the layers round it.
inline double hidden_channels(double channels, double mlp_ratio) {
  return static_cast<double>(static_cast<std::int64_t>(channels * mlp_ratio));
}

}  // namespace anigen::nn
