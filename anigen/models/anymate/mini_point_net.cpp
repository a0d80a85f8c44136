#include "anigen/models/anymate/mini_point_net.h"

#include <memory>
#include <tuple>

namespace anigen::models::anymate {
namespace {

constexpr std::int64_t kFirstWidth = 128, kLocalWidth = 256, kJoinedWidth = 2 * kLocalWidth;

// The norm sees rows, which is the same as channels first.
Tensor normalised(torch::nn::BatchNorm1d& norm, const Tensor& x) { return norm(x.flatten(0, -2)).view(x.sizes()); }

// Not amax, which shares the gradient among equal values.
Tensor group_maximum(const Tensor& x) { return std::get<0>(x.max(-2)); }

}  // namespace

PointwiseConvImpl::PointwiseConvImpl(std::int64_t in, std::int64_t out) {
  weight = register_parameter("weight", torch::empty({out, in, 1}));
  bias = register_parameter("bias", torch::empty({out}));
}

Tensor PointwiseConvImpl::forward(const Tensor& x) { return torch::linear(x, weight.squeeze(-1), bias); }

MiniPointNetImpl::MiniPointNetImpl(std::int64_t in, std::int64_t out) {
  const auto first = register_module("first_conv", std::make_shared<torch::nn::Module>());
  conv1_ = first->register_module("0", PointwiseConv(in, kFirstWidth));
  norm1_ = first->register_module("1", torch::nn::BatchNorm1d(kFirstWidth));
  conv2_ = first->register_module("3", PointwiseConv(kFirstWidth, kLocalWidth));
  const auto second = register_module("second_conv", std::make_shared<torch::nn::Module>());
  conv3_ = second->register_module("0", PointwiseConv(kJoinedWidth, kJoinedWidth));
  norm2_ = second->register_module("1", torch::nn::BatchNorm1d(kJoinedWidth));
  conv4_ = second->register_module("3", PointwiseConv(kJoinedWidth, out));
}

// The map of [whole group, point], whose first half is the same for all points of a group.
Tensor MiniPointNetImpl::second_layer(const Tensor& each, const Tensor& whole) {
  const Tensor weight = conv3_->weight.squeeze(-1);
  const Tensor of_group = torch::linear(whole, weight.slice(1, 0, kLocalWidth), conv3_->bias);
  return torch::linear(each, weight.slice(1, kLocalWidth)) + of_group.unsqueeze(-2);
}

Tensor MiniPointNetImpl::forward(const Tensor& groups) {
  const Tensor local = conv2_(torch::relu(normalised(norm1_, conv1_(groups))));
  const Tensor joined = second_layer(local, group_maximum(local));
  return group_maximum(conv4_(torch::relu(normalised(norm2_, joined))));
}

}  // namespace anigen::models::anymate
