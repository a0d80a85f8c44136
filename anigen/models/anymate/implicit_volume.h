#pragma once
#include "anigen/models/anymate/blocks.h"
#include "anigen/models/anymate/head_options.h"
#include "anigen/models/anymate/joint_volume.h"
#include "anigen/nn/init.h"

namespace anigen::models::anymate {

/// The field as a function of the position ("implicit_transformer", reference anymate-baselines.md, 3.6): each query
/// attends to the latents once. Keys `query_proj.*`, `cross_attn_decoder.*`, `ln_post.*`, `output_proj.*`.
class ImplicitVolumeImpl : public JointVolumeImpl {
 public:
  explicit ImplicitVolumeImpl(const HeadOptions& options = {}, nn::Init init = nn::Init::kPublished);
  Tensor forward(const Tensor& latents, const Tensor& queries) override;

 private:
  HeadOptions options_;
  nn::Linear query_proj_ = nullptr, output_proj_ = nullptr;
  ResidualCrossAttention cross_attn_decoder_ = nullptr;
  nn::AffineLayerNorm ln_post_ = nullptr;
};
TORCH_MODULE(ImplicitVolume);

}  // namespace anigen::models::anymate
