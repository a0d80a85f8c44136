#include "anigen/models/flop_count.h"

namespace anigen::models {

FlopCount& FlopCount::operator+=(const FlopCount& more) {
  linear += more.linear;
  attention += more.attention;
  convolution += more.convolution;
  return *this;
}

double linear_flops(double rows, double in, double out, double rank) {
  return 2.0 * rows * in * out + 2.0 * rows * rank * (in + out);
}

FlopCount cross_block_flops(const CrossBlockSize& s) {
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

double hidden_channels(double channels, double mlp_ratio) {
  return static_cast<double>(static_cast<std::int64_t>(channels * mlp_ratio));
}

}  // namespace anigen::models
