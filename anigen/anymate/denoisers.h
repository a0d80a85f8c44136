#pragma once
#include <functional>
#include <vector>

#include "anigen/anymate/blocks.h"
#include "anigen/nn/init.h"
#include "anigen/nn/torch.h"

namespace anigen::anymate {

inline constexpr std::int64_t kHarmonics = 25;  ///< real spherical harmonics up to degree 4

/// [x, sin(f_k x_d), cos(f_k x_d)] with f_k = 2^k, k = 0 … num_freqs - 1, times π if asked for; all k of the first
/// coordinate, then of the next; all sines before all cosines (docs/reference/anymate.md, 2.1). Differs from
/// nn::FourierEmbedding in frequencies and order.
/// @param x [..., D] floating @return [..., fourier_width(num_freqs, D)], dtype of x
Tensor fourier_features(const Tensor& x, std::int64_t num_freqs, bool include_pi);
inline std::int64_t fourier_width(std::int64_t num_freqs, std::int64_t dims = 3) { return dims * (2 * num_freqs + 1); }

/// Real spherical harmonics of a direction, degree by degree; the direction is taken as it is, not normalised
/// (docs/reference/anymate.md, 2.1). @param directions [..., 3] floating @return [..., 25], its dtype
Tensor spherical_harmonics(const Tensor& directions);

/// The noise levels of Anymate's diffusion and DDIM's step between them (Song et al. 2021; docs/reference/anymate.md,
/// 3.2): β linear from 1e-4 to 0.02 over all training steps, the network predicts the noise, the predicted data are
/// clamped to [-1, 1] and the noise is not formed again from them, no noise is added (η = 0). With the released 100
/// steps the last level still holds 60 % of the signal, although sampling starts from noise alone.
class DdimSchedule {
 public:
  /// @param train_steps T @throws InputError unless positive
  explicit DdimSchedule(std::int64_t train_steps = 100);

  /// x_t = √ᾱ_t x_0 + √(1 - ᾱ_t) ε. @param x_0, noise [B, ...] @param t [B] int64 in [0, T) @throws InputError
  Tensor noisy(const Tensor& x_0, const Tensor& noise, const Tensor& t) const;

  /// Levels of sampling from the noisiest: stride T / steps, ending at 0. @throws InputError unless 1 ≤ steps ≤ T
  std::vector<std::int64_t> timesteps(std::int64_t steps) const;

  struct Step {
    Tensor previous;  ///< x at the next, less noisy level
    Tensor x_0;       ///< predicted data, clamped
  };
  /// @param x at level t @param noise predicted there @param stride to the next level; below level 0 lie the data
  Step step(const Tensor& x, const Tensor& noise, std::int64_t t, std::int64_t stride = 1) const;

  std::int64_t train_steps() const { return alphas_cumprod_.size(0); }
  const Tensor& alphas_cumprod() const { return alphas_cumprod_; }  ///< [T] fp32

 private:
  Tensor alphas_cumprod_;
};

/// A network that predicts the noise in a set of joints under the latents of a shape. Neither of the two knows joints
/// by place, so any number of them can be asked for.
class JointDenoiserImpl : public torch::nn::Module {
 public:
  /// @param x [B, 3, N] noisy joints @param t integers, one for each item or one for all @param latents [B, L, W]
  /// @return [B, 3, N] @throws InputError for shapes
  virtual Tensor forward(const Tensor& x, const Tensor& t, const Tensor& latents) = 0;
};

/// One training step's terms.
struct DenoisingTerm {
  Tensor noisy;      ///< [B, 3, N], what the network saw
  Tensor predicted;  ///< [B, 3, N]
  Tensor loss;       ///< scalar: mean squared error of the predicted noise
};

/// The DDPM objective (Ho et al. 2020; docs/reference/anymate.md, 3.2).
/// @param joints [B, N, 3], the real ones repeated in turn (collate_diffusion) @param noise [B, N, 3] normal draws
/// @param t [B] int64 levels, drawn evenly @throws InputError for shapes
DenoisingTerm denoising_term(JointDenoiserImpl& model, const DdimSchedule& schedule, const Tensor& joints,
                             const Tensor& latents, const Tensor& noise, const Tensor& t);

/// Overload with noise and levels drawn from torch's default generator.
DenoisingTerm denoising_term(JointDenoiserImpl& model, const DdimSchedule& schedule, const Tensor& joints,
                             const Tensor& latents);

struct DdimSampling {
  std::int64_t steps = 0;  ///< 0: as many as were trained
  /// Called after each step; whatever it throws ends the sampling.
  std::function<void(std::int64_t step, std::int64_t steps)> progress = nullptr;
};

/// Joints from noise by DDIM, without guidance. No gradient is recorded. The released inference then takes
/// merged_joints with eps 0.05. @param noise [B, N, 3] normal draws, any N @param latents [B, L, W] @return [B, N, 3]
Tensor sample_joints(JointDenoiserImpl& model, const DdimSchedule& schedule, const Tensor& latents, const Tensor& noise,
                     const DdimSampling& sampling = {});

struct ConcatDenoiserOptions {
  std::int64_t width = 768, layers = 12, heads = 8;
  double init_scale = 0.25;
  double cond_drop_prob = 0.1;  ///< of an item's latents becoming zero while training
};

/// Denoiser of a sequence [latents, level, joints] ("Pointe_Diffusion", after Nichol et al. 2022, "Point-E";
/// docs/reference/anymate.md, 3.3). Keys `time_embed.{c_fc,c_proj}`, `ln_pre`, `backbone.resblocks.<i>.*`, `ln_post`,
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
/// al. 2024, "PointInfinity"; docs/reference/anymate.md, 3.4). Keys `prev_latent`, `z_init`, `proj_transformer.*`,
/// `input_proj`, `ln_pre`, `time_embed.{fc1,fc2}`, `latent_mlp.{fc1,fc2}`, `ln_latent`, `blocks.<i>.*`, `ln_post`,
/// `output_proj`. The condition is compressed once while nn::ConditionCache lives.
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

}  // namespace anigen::anymate
