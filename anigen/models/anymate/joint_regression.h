#pragma once
#include "anigen/models/anymate/blocks.h"
#include "anigen/models/anymate/head_options.h"
#include "anigen/nn/init.h"

namespace anigen::models::anymate {

/// Joints straight from the shape ("transformer_latent", reference anymate-baselines.md, 3.1): learned queries attend
/// to the latents once. Keys `query` [Q, W], `cross_attn_decoder.*`, `ln_post.*`, `output_proj.*`.
class JointRegressionImpl : public torch::nn::Module {
 public:
  /// @param num_joints queries, and so joints; merged_joints (dbscan.h) makes one of those that fall together
  explicit JointRegressionImpl(const HeadOptions& options = {}, std::int64_t num_joints = 96,
                               std::int64_t out_channels = 3, nn::Init init = nn::Init::kPublished);
  Tensor forward(const Tensor& latents);  ///< @param latents [B, L, W] @return [B, Q, 3] @throws InputError

 private:
  std::int64_t width_;
  Tensor query_;
  ResidualCrossAttention cross_attn_decoder_ = nullptr;
  nn::AffineLayerNorm ln_post_ = nullptr;
  nn::Linear output_proj_ = nullptr;
};
TORCH_MODULE(JointRegression);

/// Mean over the batch of the distance between two point sets: half the mean distance of each prediction to its nearest
/// joint plus half that of each joint to its nearest prediction, not squared (reference anymate-baselines.md, 6.1).
/// @param predicted [B, Q, 3] @param joints [B, J, 3], padded @param counts of real joints of each item, at least 1
/// @return scalar @throws InputError for shapes or counts that do not fit
Tensor joint_chamfer_loss(const Tensor& predicted, const Tensor& joints, const std::vector<std::int64_t>& counts);

}  // namespace anigen::models::anymate
