#pragma once
#include "anigen/models/normal_estimator/efficientnet_b5.h"
#include "anigen/models/normal_estimator/prediction_head.h"

namespace anigen::models {

/// Convolution whose kernels are standardised before use (Qiao et al. 2019, "Micro-Batch Training with Batch-Channel
/// Normalization and Weight Standardization"): of each output channel's kernel the mean is taken off, and the rest
/// divided by its unbiased deviation + 1e-5. The keys hold the kernels before that.
class StandardizedConv2dImpl : public Conv2dImpl {
 public:
  using Conv2dImpl::Conv2dImpl;
  Tensor forward(const Tensor& x);
};
TORCH_MODULE(StandardizedConv2d);

/// Doubles a map: bilinear to the size of the skip, joined with it, then twice a standardised 3 × 3 convolution, group
/// norm of 8 groups and leaky ReLU (0.01). Keys `_net.{0,1,3,4}.*`.
class UpStageImpl : public torch::nn::Module {
 public:
  UpStageImpl(std::int64_t in, std::int64_t out);
  /// @param x [B, C, h, w] @param skip [B, in − C, H, W] @return [B, out, H, W]
  Tensor forward(const Tensor& x, const Tensor& skip);

 private:
  StandardizedConv2d first_ = nullptr, second_ = nullptr;
  torch::nn::GroupNorm first_norm_ = nullptr, second_norm_ = nullptr;
};
TORCH_MODULE(UpStage);

/// x / z and y / z of the rays at the three scales of the encoder's maps, [1, 2, H/s, W/s].
struct RaySlopes {
  Tensor eighth, sixteenth, thirty_second;
};

/// What the refinement starts from, [B, ·, H/8, W/8].
struct DecoderMaps {
  Tensor normal;   ///< 3 channels, unit
  Tensor feature;  ///< 64 channels
  Tensor hidden;   ///< 64 channels, the first state of the recurrent unit
};

/// The decoder of DSINE (reference normal-estimator.md, 6): each map of the encoder joined with its rays. Keys
/// `conv2.*`, `up1.*`, `up2.*`, `normal_head.*`, `feature_head.*`, `hidden_head.*`.
class NormalDecoderImpl : public torch::nn::Module {
 public:
  NormalDecoderImpl();
  DecoderMaps forward(const EncoderMaps& maps, const RaySlopes& rays);

 private:
  Conv2d conv2_ = nullptr;
  UpStage up1_ = nullptr, up2_ = nullptr;
  PredictionHead normal_head_ = nullptr, feature_head_ = nullptr, hidden_head_ = nullptr;
};
TORCH_MODULE(NormalDecoder);

}  // namespace anigen::models
