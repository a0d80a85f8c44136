#include "anigen/train/parameter_update.h"

#include <algorithm>
#include <cmath>

namespace anigen::train {
namespace {

constexpr double kLowestLogScale = -100.0;

}  // namespace

ParameterUpdate::ParameterUpdate(ParameterBuffer& buffer, const UpdateOptions& options)
    : optimizer(buffer.master(), options.optimizer),
      ema(options.ema_rates, buffer.master()),
      buffer_(buffer),
      options_(options) {
  if (options.muon) muon.emplace(buffer, *options.muon);
  if (const auto* adaptive = std::get_if<AdaptiveGradClipper::Options>(&options.grad_clip)) clipper.emplace(*adaptive);
}

double ParameterUpdate::loss_scale() const { return options_.loss_scaling ? std::exp2(log_scale) : 1.0; }

double ParameterUpdate::clip_factor(double norm) {
  if (clipper) return clipper->update(norm);
  if (const double* fixed = std::get_if<double>(&options_.grad_clip)) {
    const double ratio = *fixed / (norm + 1e-6);
    return ratio > 1.0 ? 1.0 : ratio;
  }
  return 1.0;
}

ParameterUpdate::Result ParameterUpdate::apply(std::int64_t step) {
  torch::NoGradGuard no_grad;
  torch::Tensor gradient = buffer_.gradient();
  if (options_.loss_scaling) gradient.mul_(std::exp2(-log_scale));
  Result result;
  result.lr = options_.schedule->rate(options_.optimizer.lr, step);
  result.grad_norm = gradient.norm().item<double>();
  const double factor = clip_factor(result.grad_norm);
  // A norm can overflow over finite gradients; the factor is then 0 and the update one without gradient.
  result.skipped = !std::isfinite(result.grad_norm) && !torch::isfinite(gradient).all().item<bool>();
  recovery.before_update(step, buffer_.master());
  if (!result.skipped) {
    if (muon) {
      muon->step(buffer_, optimizer, factor, result.lr);
    } else {
      optimizer.step(buffer_.master(), gradient, factor, result.lr);
    }
    buffer_.publish();
    log_scale += options_.fp16_scale_growth;
  } else {
    log_scale = std::max(log_scale - 1.0, kLowestLogScale);
  }
  result.restored = recovery.after_update(step, buffer_.master());
  if (result.restored) buffer_.publish();
  ema.update(buffer_.master());
  return result;
}

}  // namespace anigen::train
