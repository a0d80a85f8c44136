#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models::anymate {

using torch::Tensor;

/// Convolution with a kernel of one, over values whose channels come last: a linear map with `weight` [out, in, 1] and
/// `bias` [out], as the state dict of a Conv1d has them. Not initialised.
class PointwiseConvImpl : public torch::nn::Module {
 public:
  PointwiseConvImpl(std::int64_t in, std::int64_t out);
  Tensor forward(const Tensor& x);  ///< @param x [..., in] @return [..., out]

  Tensor weight, bias;
};
TORCH_MODULE(PointwiseConv);

/// What a group of points looks like (Yu et al. 2022, "Point-BERT", after PointNet; reference
/// anymate-baselines.md, 2.2): each point through two layers, the maximum over the group beside each, two more layers,
/// the maximum again. Batch norms take statistics over all points while training and their running ones in evaluation.
/// Keys `first_conv.{0,1,3}` and `second_conv.{0,1,3}`, of which 1 is the norm.
class MiniPointNetImpl : public torch::nn::Module {
 public:
  MiniPointNetImpl(std::int64_t in, std::int64_t out);
  Tensor forward(const Tensor& groups);  ///< @param groups [B, G, M, in] @return [B, G, out]

 private:
  Tensor second_layer(const Tensor& each, const Tensor& whole);

  PointwiseConv conv1_ = nullptr, conv2_ = nullptr, conv3_ = nullptr, conv4_ = nullptr;
  torch::nn::BatchNorm1d norm1_ = nullptr, norm2_ = nullptr;
};
TORCH_MODULE(MiniPointNet);

}  // namespace anigen::models::anymate
