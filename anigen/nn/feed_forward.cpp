#include "anigen/nn/feed_forward.h"

namespace anigen::nn {

FeedForwardImpl::FeedForwardImpl(std::int64_t in_channels, std::int64_t out_channels, double mlp_ratio) {
  const auto hidden = static_cast<std::int64_t>(static_cast<double>(in_channels) * mlp_ratio);
  mlp_ = register_module("mlp", Mlp(in_channels, hidden, out_channels));
}

}  // namespace anigen::nn
