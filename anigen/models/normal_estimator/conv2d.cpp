#include "anigen/models/normal_estimator/conv2d.h"

#include <algorithm>

namespace anigen::models {
namespace {

// How one axis is padded: by as much at both ends as the library wants it, and how many outputs to drop in front.
struct AxisPadding {
  std::int64_t both_ends, drop, outputs;
};

AxisPadding same_padding(std::int64_t size, std::int64_t kernel, std::int64_t stride) {
  const std::int64_t outputs = (size + stride - 1) / stride;
  const std::int64_t zeros = std::max<std::int64_t>((outputs - 1) * stride + kernel - size, 0);
  const std::int64_t before = zeros / 2;
  if (zeros % 2 == 0) return {before, 0, outputs};
  // One zero more behind: a whole stride more at both ends, and the one output that it adds in front dropped. A padded
  // copy of the input would be the largest tensor of the network.
  return {before + stride, 1, outputs};
}

}  // namespace

Conv2dImpl::Conv2dImpl(std::int64_t in_channels, std::int64_t out_channels, std::int64_t kernel, bool with_bias,
                       std::int64_t groups)
    : groups_(groups) {
  weight = register_parameter("weight", torch::empty({out_channels, in_channels / groups, kernel, kernel}));
  if (with_bias) bias = register_parameter("bias", torch::empty({out_channels}));
}

Tensor Conv2dImpl::forward(const Tensor& x) { return same_convolution(x, weight, bias, /*stride=*/1, groups_); }

Tensor same_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias, std::int64_t stride,
                        std::int64_t groups) {
  const AxisPadding rows = same_padding(x.size(2), weight.size(2), stride);
  const AxisPadding columns = same_padding(x.size(3), weight.size(3), stride);
  const Tensor all = at::conv2d(x, weight, bias, {stride, stride}, {rows.both_ends, columns.both_ends},
                                /*dilation=*/at::IntArrayRef{1, 1}, groups);
  return all.narrow(2, rows.drop, rows.outputs).narrow(3, columns.drop, columns.outputs);
}

}  // namespace anigen::models
