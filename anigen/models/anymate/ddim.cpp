#include "anigen/models/anymate/ddim.h"

#include <cmath>
#include <string>

#include "anigen/models/anymate/checks.h"

namespace anigen::models::anymate {
namespace {

constexpr double kFirstBeta = 1e-4, kLastBeta = 0.02, kClip = 1.0;

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

}  // namespace anigen::models::anymate
