#pragma once
#include "anigen/models/anymate/blocks.h"
#include "anigen/models/anymate/joint_denoiser.h"
#include "anigen/nn/init.h"

namespace anigen::models::anymate {

struct ConcatDenoiserOptions {
  std::int64_t width = 768, layers = 12, heads = 8;
  double init_scale = 0.25;
  double cond_drop_prob = 0.1;  ///< of an item's latents becoming zero while training
};

/// Denoiser of a sequence [latents, level, joints] ("Pointe_Diffusion", after Nichol et al. 2022, "Point-E"; reference
/// anymate-baselines.md, 3.3). Keys `time_embed.{c_fc,c_proj}`, `ln_pre`, `backbone.resblocks.<i>.*`, `ln_post`,
/// `input_proj`, `output_proj`.
class ConcatDenoiserImpl : public JointDenoiserImpl {
 public:
  explicit ConcatDenoiserImpl(const ConcatDenoiserOptions& options = {}, nn::Init init = nn::Init::kPublished);
  Tensor forward(const Tensor& x, const Tensor& t, const Tensor& latents) override;

 private:
  ConcatDenoiserOptions options_;
  ErfMlp time_embed_ = nullptr;
  nn::AffineLayerNorm ln_pre_ = nullptr, ln_post_ = nullptr;
  ResidualStack backbone_ = nullptr;
  nn::Linear input_proj_ = nullptr, output_proj_ = nullptr;
};
TORCH_MODULE(ConcatDenoiser);

}  // namespace anigen::models::anymate
