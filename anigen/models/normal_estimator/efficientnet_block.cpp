#include "anigen/models/normal_estimator/efficientnet_block.h"

#include <algorithm>

namespace anigen::models {
namespace {

constexpr std::int64_t kExpansion = 6;
// Values of an expanded tensor that are held at once, and the fewest channels: the network's largest tensors stand
// here, and what happens to them happens to every channel for itself.
constexpr std::int64_t kExpandedValues = std::int64_t{1} << 24, kFewestChannels = 16;

std::int64_t channels_at_once(const Tensor& x, std::int64_t channels) {
  const std::int64_t fitting = kExpandedValues / (x.size(0) * x.size(2) * x.size(3));
  return std::min(std::max(fitting / kFewestChannels * kFewestChannels, kFewestChannels), channels);
}

Tensor with_skip(Tensor y, const Tensor& x) { return y.sizes() == x.sizes() ? y.add_(x) : y; }

}  // namespace

SqueezeExciteImpl::SqueezeExciteImpl(std::int64_t channels, std::int64_t block_inputs) {
  const std::int64_t narrow = std::max<std::int64_t>((block_inputs + 2) / 4, 1);  // a quarter, rounded
  conv_reduce_ = register_module("conv_reduce", Conv2d(channels, narrow, 1));
  conv_expand_ = register_module("conv_expand", Conv2d(narrow, channels, 1));
}

Tensor SqueezeExciteImpl::forward(Tensor x) {
  const Tensor mean = x.mean({2, 3}, /*keepdim=*/true);
  return x.mul_(torch::sigmoid(conv_expand_(torch::silu(conv_reduce_(mean)))));
}

DepthwiseSeparableImpl::DepthwiseSeparableImpl(std::int64_t in, std::int64_t out, std::int64_t kernel) {
  conv_dw_ = register_module("conv_dw", Conv2d(in, in, kernel, /*with_bias=*/false, /*groups=*/in));
  bn1_ = register_module("bn1", BatchNormState(in));
  se_ = register_module("se", SqueezeExcite(in, in));
  conv_pw_ = register_module("conv_pw", Conv2d(in, out, 1, /*with_bias=*/false));
  bn2_ = register_module("bn2", BatchNormState(out));
}

Tensor DepthwiseSeparableImpl::forward(const Tensor& x) {
  Tensor y = FoldedConvolution(conv_dw_, bn1_).apply(x, /*stride=*/1, /*groups=*/x.size(1));
  y = se_(torch::silu_(y));
  return with_skip(FoldedConvolution(conv_pw_, bn2_).apply(y), x);
}

InvertedResidualImpl::InvertedResidualImpl(std::int64_t in, std::int64_t out, std::int64_t kernel, std::int64_t stride)
    : stride_(stride) {
  const std::int64_t wide = kExpansion * in;
  conv_pw_ = register_module("conv_pw", Conv2d(in, wide, 1, /*with_bias=*/false));
  bn1_ = register_module("bn1", BatchNormState(wide));
  conv_dw_ = register_module("conv_dw", Conv2d(wide, wide, kernel, /*with_bias=*/false, /*groups=*/wide));
  bn2_ = register_module("bn2", BatchNormState(wide));
  se_ = register_module("se", SqueezeExcite(wide, in));
  conv_pwl_ = register_module("conv_pwl", Conv2d(wide, out, 1, /*with_bias=*/false));
  bn3_ = register_module("bn3", BatchNormState(out));
}

Tensor InvertedResidualImpl::expanded(const Tensor& x) const {
  const FoldedConvolution expand(conv_pw_, bn1_), filter(conv_dw_, bn2_);
  const std::int64_t channels = expand.bias.size(0), step = channels_at_once(x, channels);
  Tensor all;
  for (std::int64_t begin = 0; begin < channels; begin += step) {
    const std::int64_t end = std::min(begin + step, channels);
    Tensor part = expand.channels(begin, end).apply(x);
    part = filter.channels(begin, end).apply(torch::silu_(part), stride_, /*groups=*/end - begin);
    torch::silu_(part);
    if (step >= channels) return part;
    if (!all.defined()) all = torch::empty({x.size(0), channels, part.size(2), part.size(3)}, part.options());
    all.slice(1, begin, end).copy_(part);
  }
  return all;
}

Tensor InvertedResidualImpl::forward(const Tensor& x) {
  return with_skip(FoldedConvolution(conv_pwl_, bn3_).apply(se_(expanded(x))), x);
}

}  // namespace anigen::models
