#pragma once
#include "anigen/models/anymate/joint_denoiser.h"
#include "anigen/models/anymate/read_write_blocks.h"
#include "anigen/nn/init.h"

namespace anigen::models::anymate {

struct CrossDenoiserOptions {
  std::int64_t num_z = 16;        ///< learned latents of the denoiser
  std::int64_t num_latents = 16;  ///< tokens of the condition, after compression if there is one
  std::int64_t z_dim = 768, x_dim = 512, num_blocks = 4, num_compute_layers = 4, num_heads = 8;
  double mlp_ratio = 4.0;
  bool qkv_bias = true;
  bool use_projection = true;  ///< compress the condition to num_latents tokens; false: it has so many
};

/// The condition in a few tokens: learned queries attend to it once. Keys `query`, `cross_attn.*`, `output_proj.*`.
class LatentCompressionImpl : public torch::nn::Module {
 public:
  LatentCompressionImpl(std::int64_t num_latents, std::int64_t width, std::int64_t heads);
  Tensor forward(const Tensor& latents);  ///< @param latents [B, L, W] @return [B, num_latents, W]

  Tensor query;

 private:
  ResidualCrossAttention cross_attn_ = nullptr;
  nn::Linear output_proj_ = nullptr;
};
TORCH_MODULE(LatentCompression);

/// Denoiser that reads joints into latents, computes there and writes back ("Cross_Attention_Diffusion", after Huang et
/// al. 2024, "PointInfinity"; reference anymate-baselines.md, 3.4). Keys `prev_latent`, `z_init`, `proj_transformer.*`,
/// `input_proj`, `ln_pre`, `time_embed.{fc1,fc2}`, `latent_mlp.{fc1,fc2}`, `ln_latent`, `blocks.<i>.*`, `ln_post`,
/// `output_proj`. The condition is compressed once while nn::KeptContexts lives.
class CrossDenoiserImpl : public JointDenoiserImpl {
 public:
  explicit CrossDenoiserImpl(const CrossDenoiserOptions& options = {}, nn::Init init = nn::Init::kPublished);
  Tensor forward(const Tensor& x, const Tensor& t, const Tensor& latents) override;

 private:
  Tensor latent_stream(const Tensor& t, const Tensor& latents);
  void initialize();

  CrossDenoiserOptions options_;
  Tensor prev_latent_, z_init_;
  LatentCompression proj_transformer_ = nullptr;
  nn::Linear input_proj_ = nullptr, output_proj_ = nullptr;
  nn::AffineLayerNorm ln_pre_ = nullptr, ln_latent_ = nullptr, ln_post_ = nullptr;
  ErfMlp time_embed_ = nullptr, latent_mlp_ = nullptr;
  std::vector<ReadComputeWrite> blocks_;
};
TORCH_MODULE(CrossDenoiser);

}  // namespace anigen::models::anymate
