#include "anigen/anymate/denoisers.h"

#include <cmath>
#include <string>

#include "anigen/core/numeric.h"
#include "anigen/nn/condition_cache.h"
#include "anigen/nn/embeddings.h"
#include "anigen/nn/linear.h"

namespace anigen::anymate {

Tensor fourier_features(const Tensor& x, std::int64_t num_freqs, bool include_pi) {
  require(x.defined() && x.dim() >= 1 && x.is_floating_point(), "coordinates", "must be floating-point [..., D]");
  require(num_freqs >= 0, "num_freqs", "must not be negative");
  // Formed in fp32 as the released code does: at the highest frequency one unit in the last place moves the sine.
  Tensor frequencies = torch::pow(2.0, torch::arange(num_freqs, torch::kFloat32));
  if (include_pi) frequencies = frequencies * kPi;
  const Tensor arguments = (x.unsqueeze(-1) * frequencies.to(x.options())).flatten(-2);  // [..., D·F]
  return torch::cat({x, arguments.sin(), arguments.cos()}, -1);
}

Tensor spherical_harmonics(const Tensor& directions) {
  require(directions.defined() && directions.dim() >= 1 && directions.size(-1) == 3 && directions.is_floating_point(),
          "directions", "must be floating-point [..., 3]");
  const Tensor x = directions.select(-1, 0), y = directions.select(-1, 1), z = directions.select(-1, 2);
  const Tensor xx = x * x, yy = y * y, zz = z * z;
  const Tensor xy = x * y, yz = y * z, xz = x * z;
  const Tensor saddle = xx - yy;                                  // cos 2φ
  const Tensor cubic_x = xx - 3.0 * yy, cubic_y = 3.0 * xx - yy;  // of degree 3 in x and y, without their first factor
  const Tensor band_3 = 5.0 * zz - 1.0, band_4 = 7.0 * zz - 3.0, band_4_2 = 7.0 * zz - 1.0;
  // Degree after degree, order from -l to l; constants are the usual normalisation on the unit sphere.
  return torch::stack({torch::full_like(x, 0.28209479177387814),
                       0.4886025119029199 * y,
                       0.4886025119029199 * z,
                       0.4886025119029199 * x,
                       1.0925484305920792 * xy,
                       1.0925484305920792 * yz,
                       0.9461746957575601 * zz - 0.31539156525251999,
                       1.0925484305920792 * xz,
                       0.5462742152960396 * saddle,
                       0.5900435899266435 * y * cubic_y,
                       2.890611442640554 * xy * z,
                       0.4570457994644658 * y * band_3,
                       0.3731763325901154 * z * (5.0 * zz - 3.0),
                       0.4570457994644658 * x * band_3,
                       1.445305721320277 * z * saddle,
                       0.5900435899266435 * x * cubic_x,
                       2.5033429417967046 * xy * saddle,
                       1.7701307697799304 * yz * cubic_y,
                       0.9461746957575601 * xy * band_4_2,
                       0.6690465435572892 * yz * band_4,
                       0.10578554691520431 * (35.0 * zz * zz - 30.0 * zz + 3.0),
                       0.6690465435572892 * xz * band_4,
                       0.47308734787878004 * saddle * band_4_2,
                       1.7701307697799304 * xz * cubic_x,
                       0.6258357354491761 * (xx * cubic_x - yy * cubic_y)},
                      -1);
}

namespace {

constexpr double kFirstBeta = 1e-4, kLastBeta = 0.02, kClip = 1.0;

constexpr double kLatentDeviation = 0.02;

// The sinusoid of t for a network: t flattened to one for each item.
Tensor level_features(const Tensor& t, std::int64_t items, std::int64_t width) {
  require(t.defined() && (t.numel() == 1 || t.numel() == items), "t",
          "must be one number, or one for each of " + std::to_string(items) + " items");
  return nn::timestep_features(t.flatten(), width).expand({items, width});
}

}  // namespace

DdimSchedule::DdimSchedule(std::int64_t train_steps) {
  require(train_steps > 0, "num_train_step", "must be positive");
  alphas_cumprod_ = (1.0 - torch::linspace(kFirstBeta, kLastBeta, train_steps, torch::kFloat32)).cumprod(0);
}

Tensor DdimSchedule::noisy(const Tensor& x_0, const Tensor& noise, const Tensor& t) const {
  require(x_0.defined() && x_0.dim() > 0, "x_0", "must have an axis of items");
  require_shape(noise, x_0.sizes().vec(), "noise");
  require_shape(t, {x_0.size(0)}, "t");
  require(t.numel() == 0 || (t.min().item<std::int64_t>() >= 0 && t.max().item<std::int64_t>() < train_steps()), "t",
          "must be in [0, " + std::to_string(train_steps()) + ")");
  std::vector<std::int64_t> shape(static_cast<std::size_t>(x_0.dim()), 1);
  shape[0] = x_0.size(0);
  const Tensor levels = alphas_cumprod_.to(x_0.device()).index_select(0, t.to(x_0.device(), torch::kInt64));
  const Tensor alpha = levels.to(nn::dtype_of(x_0)).view(shape);
  return alpha.sqrt() * x_0 + (1.0 - alpha).sqrt() * noise;
}

std::vector<std::int64_t> DdimSchedule::timesteps(std::int64_t steps) const {
  require(steps >= 1 && steps <= train_steps(), "num_inference_steps",
          "must be from 1 to " + std::to_string(train_steps()));
  const std::int64_t stride = train_steps() / steps;
  std::vector<std::int64_t> times;
  for (std::int64_t i = steps - 1; i >= 0; --i) times.push_back(i * stride);
  return times;
}

DdimSchedule::Step DdimSchedule::step(const Tensor& x, const Tensor& noise, std::int64_t t, std::int64_t stride) const {
  require(t >= 0 && t < train_steps() && stride > 0, "t", "is no level of the schedule");
  require_shape(noise, x.sizes().vec(), "noise");
  const double alpha = alphas_cumprod_[t].item<float>();
  const double next = t >= stride ? static_cast<double>(alphas_cumprod_[t - stride].item<float>()) : 1.0;
  Step result;
  result.x_0 = ((x - std::sqrt(1.0 - alpha) * noise) / std::sqrt(alpha)).clamp(-kClip, kClip);
  result.previous = std::sqrt(next) * result.x_0 + std::sqrt(1.0 - next) * noise;
  return result;
}

DenoisingTerm denoising_term(JointDenoiserImpl& model, const DdimSchedule& schedule, const Tensor& joints,
                             const Tensor& latents, const Tensor& noise, const Tensor& t) {
  require_shape(joints, {-1, -1, 3}, "joints");
  DenoisingTerm term;
  term.noisy = schedule.noisy(joints, noise, t).transpose(1, 2);
  term.predicted = model.forward(term.noisy, t, latents);
  term.loss = torch::mse_loss(term.predicted, noise.transpose(1, 2));
  return term;
}

DenoisingTerm denoising_term(JointDenoiserImpl& model, const DdimSchedule& schedule, const Tensor& joints,
                             const Tensor& latents) {
  require_shape(joints, {-1, -1, 3}, "joints");
  const Tensor t = torch::randint(schedule.train_steps(), {joints.size(0)}, torch::kInt64).to(joints.device());
  return denoising_term(model, schedule, joints, latents, torch::randn_like(joints), t);
}

Tensor sample_joints(JointDenoiserImpl& model, const DdimSchedule& schedule, const Tensor& latents, const Tensor& noise,
                     const DdimSampling& sampling) {
  require_shape(noise, {-1, -1, 3}, "noise");
  const torch::NoGradGuard no_grad;
  const nn::ConditionCache contexts;  // what a network makes of the latents is the same at every step
  const std::int64_t steps = sampling.steps > 0 ? sampling.steps : schedule.train_steps();
  const std::vector<std::int64_t> times = schedule.timesteps(steps);
  Tensor x = noise.transpose(1, 2);
  for (std::size_t i = 0; i < times.size(); ++i) {
    const Tensor t = torch::full({1}, times[i], torch::TensorOptions().dtype(torch::kInt64).device(x.device()));
    x = schedule.step(x, model.forward(x, t, latents), times[i], schedule.train_steps() / steps).previous;
    if (sampling.progress) sampling.progress(static_cast<std::int64_t>(i) + 1, steps);
  }
  return x.transpose(1, 2).contiguous();
}

ConcatDenoiserImpl::ConcatDenoiserImpl(const ConcatDenoiserOptions& options, nn::Init init) : options_(options) {
  require(options.cond_drop_prob >= 0.0 && options.cond_drop_prob <= 1.0, "cond_drop_prob", "must be in [0, 1]");
  const std::int64_t width = options.width;
  time_embed_ = register_module("time_embed", ErfMlp(width, 4 * width, width));
  ln_pre_ = register_module("ln_pre", nn::AffineLayerNorm(width, kNormEps));
  backbone_ = register_module("backbone", ResidualStack(options.layers, width, options.heads, /*qkv_bias=*/true));
  ln_post_ = register_module("ln_post", nn::AffineLayerNorm(width, kNormEps));
  input_proj_ = register_module("input_proj", nn::Linear(3, width));
  output_proj_ = register_module("output_proj", nn::Linear(width, 3));
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  const double deviation = options.init_scale / std::sqrt(static_cast<double>(width));
  normal_blocks(*this, deviation);
  time_embed_->apply([deviation](torch::nn::Module& part) {
    if (auto* linear = part.as<nn::LinearImpl>()) nn::normal_linear(*linear, deviation);
  });
  nn::zero_parameters(*output_proj_);
}

Tensor ConcatDenoiserImpl::forward(const Tensor& x, const Tensor& t, const Tensor& latents) {
  require_shape(x, {-1, 3, -1}, "x");
  require_shape(latents, {x.size(0), -1, options_.width}, "latents");
  Tensor condition = latents;
  if (is_training() && options_.cond_drop_prob > 0.0) {
    const Tensor kept = torch::rand({x.size(0), 1, 1}, latents.options()) >= options_.cond_drop_prob;
    condition = condition * kept.to(latents.dtype());
  }
  const Tensor level = time_embed_(level_features(t, x.size(0), options_.width).to(latents.options())).unsqueeze(1);
  const Tensor sequence = torch::cat({condition, level, input_proj_(x.transpose(1, 2))}, 1);
  const Tensor out = ln_post_(backbone_(ln_pre_(sequence)));
  return output_proj_(out.slice(1, latents.size(1) + 1)).transpose(1, 2);
}

LatentCompressionImpl::LatentCompressionImpl(std::int64_t num_latents, std::int64_t width, std::int64_t heads) {
  query = register_parameter("query", torch::empty({num_latents, width}));
  cross_attn_ = register_module("cross_attn", ResidualCrossAttention(width, heads, /*qkv_bias=*/true));
  output_proj_ = register_module("output_proj", nn::Linear(width, width));
}

Tensor LatentCompressionImpl::forward(const Tensor& latents) {
  return output_proj_(cross_attn_(query.unsqueeze(0).expand({latents.size(0), -1, -1}), latents));
}

CrossDenoiserImpl::CrossDenoiserImpl(const CrossDenoiserOptions& options, nn::Init init) : options_(options) {
  require(options.num_z > 0 && options.num_latents > 0, "num_z", "there must be latents");
  const std::int64_t z_dim = options.z_dim, x_dim = options.x_dim;
  const std::int64_t tokens = options.num_z + options.num_latents + 1;  // and the level
  const auto hidden = static_cast<std::int64_t>(static_cast<double>(z_dim) * options.mlp_ratio);
  prev_latent_ = register_parameter("prev_latent", torch::empty({1, tokens, z_dim}));
  z_init_ = register_parameter("z_init", torch::empty({1, options.num_z, z_dim}));
  if (options.use_projection) {
    proj_transformer_ =
        register_module("proj_transformer", LatentCompression(options.num_latents, z_dim, options.num_heads));
  }
  input_proj_ = register_module("input_proj", nn::Linear(3, x_dim));
  ln_pre_ = register_module("ln_pre", nn::AffineLayerNorm(x_dim, kNormEps));
  time_embed_ = register_module("time_embed", ErfMlp(z_dim, hidden, z_dim, "fc1", "fc2"));
  latent_mlp_ = register_module("latent_mlp", ErfMlp(z_dim, hidden, z_dim, "fc1", "fc2"));
  ln_latent_ = register_module("ln_latent", nn::AffineLayerNorm(z_dim, kNormEps));
  const ReadWriteOptions streams = {z_dim, x_dim, options.num_heads, options.mlp_ratio, options.qkv_bias};
  for (std::int64_t i = 0; i < options.num_blocks; ++i) blocks_.emplace_back(streams, options.num_compute_layers);
  register_module("blocks", nn::module_list(blocks_));
  ln_post_ = register_module("ln_post", nn::AffineLayerNorm(x_dim, kNormEps));
  output_proj_ = register_module("output_proj", nn::Linear(x_dim, 3));
  if (init == nn::Init::kPublished) initialize();
}

void CrossDenoiserImpl::initialize() {
  nn::default_norms(*this);
  nn::xavier_uniform_linears(*this);
  nn::zero_parameters(*ln_latent_);
  torch::nn::init::zeros_(prev_latent_);
  torch::nn::init::normal_(z_init_, 0.0, kLatentDeviation);
  if (!proj_transformer_.is_empty()) torch::nn::init::normal_(proj_transformer_->query, 0.0, kLatentDeviation);
}

Tensor CrossDenoiserImpl::latent_stream(const Tensor& t, const Tensor& latents) {
  const std::int64_t items = latents.size(0);
  const Tensor condition = proj_transformer_.is_empty()
                               ? latents
                               : nn::context_of(this, latents, [&] { return proj_transformer_(latents); });
  const Tensor level = time_embed_(level_features(t, items, options_.z_dim).to(latents.options())).unsqueeze(1);
  const Tensor z = torch::cat({z_init_.expand({items, -1, -1}), condition, level}, 1);
  // In place of PointInfinity's latents of the step before, a learned constant.
  return z + ln_latent_(prev_latent_ + latent_mlp_(prev_latent_.detach()));
}

Tensor CrossDenoiserImpl::forward(const Tensor& x, const Tensor& t, const Tensor& latents) {
  require_shape(x, {-1, 3, -1}, "x");
  require_shape(latents, {x.size(0), options_.use_projection ? -1 : options_.num_latents, options_.z_dim}, "latents");
  Tensor points = ln_pre_(input_proj_(x.transpose(1, 2)));
  Tensor z = latent_stream(t, latents);
  for (ReadComputeWrite& block : blocks_) block->forward(z, points);
  return output_proj_(ln_post_(points)).transpose(1, 2);
}

}  // namespace anigen::anymate
