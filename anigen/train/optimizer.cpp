#include "anigen/train/optimizer.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/kernel_form.h"
#include "anigen/core/numeric.h"

namespace anigen::train {

namespace {

void require_positive(std::int64_t value, const char* name) {
  if (value < 1) throw InputError("", name, "must be at least 1, is " + std::to_string(value));
}

struct Coefficients {
  float gradient, decay, l2, beta1, one_minus_beta1, beta2, one_minus_beta2, root_correction, eps, step_size;
};

ANIGEN_EXACT_KERNEL(void, adamw_pass,
                    (float* __restrict p, const float* __restrict g, float* __restrict m, float* __restrict v,
                     std::int64_t n, const Coefficients c),
                    (p, g, m, v, n, c)) {
  for (std::int64_t i = 0; i < n; ++i) {
    // g_t; m_t = β₁ m + (1 − β₁) g_t; v_t = β₂ v + (1 − β₂) g_t²; θ ← (1 − ηλ) θ − η m̂_t / (√v̂_t + ε)
    const float gradient = g[i] * c.gradient + c.l2 * p[i];
    m[i] = c.beta1 * m[i] + c.one_minus_beta1 * gradient;
    v[i] = c.beta2 * v[i] + c.one_minus_beta2 * gradient * gradient;
    const float denominator = __builtin_sqrtf(v[i]) * c.root_correction + c.eps;
    p[i] = p[i] * c.decay - c.step_size * (m[i] / denominator);
  }
}

void check(bool ok, const char* name, const char* what) {
  if (!ok) throw InputError("", std::string("optimizer/args/") + name, what);
}

/// A sum that is finite has only finite terms; one that is not may also have overflowed.
bool all_finite(const torch::Tensor& flat) {
  return std::isfinite(flat.sum().item<double>()) || torch::isfinite(flat).all().item<bool>();
}

constexpr double kLowestLogScale = -100.0;

}  // namespace

LrSchedule unscheduled() {
  return [](double base, std::int64_t) { return base; };
}

LrSchedule linear_lr(double start_factor, double end_factor, std::int64_t total_iters) {
  require_positive(total_iters, "total_iters");
  return [=](double base, std::int64_t step) {
    const double done = static_cast<double>(std::min(step, total_iters)) / static_cast<double>(total_iters);
    return base * (start_factor + (end_factor - start_factor) * done);
  };
}

LrSchedule cosine_annealing_lr(std::int64_t t_max, double eta_min) {
  require_positive(t_max, "T_max");
  return [=](double base, std::int64_t step) {
    const double angle = kPi * static_cast<double>(step % (2 * t_max)) / static_cast<double>(t_max);
    return eta_min + (base - eta_min) * 0.5 * (1.0 + std::cos(angle));
  };
}

LrSchedule constant_lr(double factor, std::int64_t total_iters) {
  if (total_iters < 0) throw InputError("", "total_iters", "must not be negative");
  return [=](double base, std::int64_t step) { return step < total_iters ? base * factor : base; };
}

LrSchedule multi_step_lr(std::vector<std::int64_t> milestones, double gamma) {
  return [milestones = std::move(milestones), gamma](double base, std::int64_t step) {
    const auto reached = std::count_if(milestones.begin(), milestones.end(), [&](auto at) { return at <= step; });
    return base * std::pow(gamma, static_cast<double>(reached));
  };
}

LrSchedule linear_warmup_lr(std::int64_t warmup_steps) {
  require_positive(warmup_steps, "warmup_steps");
  return [=](double base, std::int64_t step) {
    return base * std::min(1.0, static_cast<double>(step + 1) / static_cast<double>(warmup_steps));
  };
}

std::int64_t common_steps(const LrSchedule& one, const LrSchedule& other, double base, std::int64_t most) {
  std::int64_t step = 0;
  while (step < most && one(base, step) == other(base, step)) ++step;
  return step;
}

std::int64_t steps_before_decay(const LrSchedule& schedule, double base, std::int64_t steps) {
  constexpr std::int64_t kMost = 10'000'000;
  std::int64_t last = 0;
  double highest = 0.0;
  for (std::int64_t step = 0; steps <= kMost && step < steps; ++step) {
    const double rate = schedule(base, step);
    if (rate < highest) continue;
    highest = rate;
    last = step + 1;
  }
  return last;
}

LrSchedule sequential_lr(std::vector<LrSchedule> schedules, std::vector<std::int64_t> milestones) {
  if (schedules.empty() || milestones.size() + 1 != schedules.size()) {
    throw InputError("", "milestones",
                     std::to_string(schedules.size()) + " schedules need one milestone fewer, not " +
                         std::to_string(milestones.size()));
  }
  if (!std::is_sorted(milestones.begin(), milestones.end()) || (!milestones.empty() && milestones.front() < 0))
    throw InputError("", "milestones",
                     "must not be negative and must not decrease; a fraction of max_steps may lie before a fixed step");
  return [schedules = std::move(schedules), milestones = std::move(milestones)](double base, std::int64_t step) {
    const auto i =
        static_cast<std::size_t>(std::upper_bound(milestones.begin(), milestones.end(), step) - milestones.begin());
    return schedules[i](base, i == 0 ? step : step - milestones[i - 1]);
  };
}

AdamW::AdamW(const torch::Tensor& parameters, const Options& options)
    : exp_avg(torch::zeros_like(parameters)), exp_avg_sq(torch::zeros_like(parameters)), options_(options) {
  check(options.lr >= 0.0 && std::isfinite(options.lr), "lr", "must be a number that is not negative");
  for (const double beta : options.betas) check(beta >= 0.0 && beta < 1.0, "betas", "must lie in [0, 1)");
  check(options.eps > 0.0, "eps", "must be positive");
  check(options.weight_decay >= 0.0, "weight_decay", "must not be negative");
}

void AdamW::step(torch::Tensor parameters, const torch::Tensor& gradients, double gradient_factor, double lr) {
  torch::NoGradGuard no_grad;
  ++steps;
  const double beta1 = options_.betas[0], beta2 = options_.betas[1];
  const double correction1 = 1.0 - std::pow(beta1, static_cast<double>(steps));
  const double correction2 = 1.0 - std::pow(beta2, static_cast<double>(steps));
  const double decay = options_.decoupled ? 1.0 - lr * options_.weight_decay : 1.0;
  const double l2 = options_.decoupled ? 0.0 : options_.weight_decay;
  if (parameters.is_cpu() && parameters.scalar_type() == torch::kFloat32) {
    const Coefficients c{static_cast<float>(gradient_factor),
                         static_cast<float>(decay),
                         static_cast<float>(l2),
                         static_cast<float>(beta1),
                         static_cast<float>(1.0 - beta1),
                         static_cast<float>(beta2),
                         static_cast<float>(1.0 - beta2),
                         static_cast<float>(1.0 / std::sqrt(correction2)),
                         static_cast<float>(options_.eps),
                         static_cast<float>(lr / correction1)};
    adamw_pass(parameters.data_ptr<float>(), gradients.data_ptr<float>(), exp_avg.data_ptr<float>(),
               exp_avg_sq.data_ptr<float>(), parameters.numel(), c);
    return;
  }
  torch::Tensor gradient = gradients * gradient_factor;
  if (l2 != 0.0) gradient.add_(parameters, l2);
  exp_avg.mul_(beta1).add_(gradient, 1.0 - beta1);
  exp_avg_sq.mul_(beta2).addcmul_(gradient, gradient, 1.0 - beta2);
  const torch::Tensor denominator = exp_avg_sq.sqrt().div_(std::sqrt(correction2)).add_(options_.eps);
  parameters.mul_(decay).addcdiv_(exp_avg, denominator, -lr / correction1);
}

torch::Tensor orthogonalize(const torch::Tensor& matrix) {
  constexpr double kA = 3.4445, kB = -4.7750, kC = 2.0315;  // X ← a X + (b A + c A²) X with A = X Xᵀ
  // Working on the wide orientation keeps the Gram matrix small.
  const bool tall = matrix.size(0) > matrix.size(1);
  torch::Tensor x = tall ? matrix.t() : matrix;
  x = x / (x.norm() + 1e-7);
  for (int i = 0; i < 5; ++i) {
    const torch::Tensor gram = x.mm(x.t());
    const torch::Tensor polynomial = torch::addmm(gram, gram, gram, kB, kC);
    x = torch::addmm(x, polynomial, x, kA, 1.0);
  }
  return tall ? x.t() : x;
}

Muon::Muon(const ParameterBuffer& buffer, const Options& options)
    : momentum(torch::zeros_like(buffer.master())), options_(options) {
  if (!(options.momentum >= 0.0 && options.momentum < 1.0))
    throw InputError("", "/trainer/args/optimizer/args/momentum", "must be in [0, 1)");
  for (std::size_t i = 0; i < buffer.slots().size(); ++i) {
    const torch::Tensor& parameter = buffer.slots()[i].parameter;
    if (parameter.dim() == 2 && std::min(parameter.size(0), parameter.size(1)) >= options.min_side)
      matrices_.push_back(i);
  }
}

void Muon::step(ParameterBuffer& buffer, AdamW& rest, double gradient_factor, double lr) {
  const torch::NoGradGuard no_grad;
  const double beta = options_.momentum;
  std::vector<torch::Tensor> before;
  before.reserve(matrices_.size());
  for (const std::size_t i : matrices_) before.push_back(buffer.part(buffer.master(), buffer.slots()[i]).clone());
  // One pass of AdamW over everything is cheaper than gathering its parts; the matrices are then set back.
  rest.step(buffer.master(), buffer.gradient(), gradient_factor, lr);
  for (std::size_t k = 0; k < matrices_.size(); ++k) {
    const ParameterBuffer::Slot& slot = buffer.slots()[matrices_[k]];
    // μ ← β μ + (1 − β) g; O = orthogonalised (1 − β) g + β μ; W ← (1 − ηλ) W − 0.2 η √max(m, n) O
    const torch::Tensor gradient = buffer.part(buffer.gradient(), slot) * gradient_factor;
    torch::Tensor average = buffer.part(momentum, slot);
    average.mul_(beta).add_(gradient, 1.0 - beta);
    const torch::Tensor direction = orthogonalize(gradient * (1.0 - beta) + average * beta);
    const double scale = 0.2 * std::sqrt(static_cast<double>(std::max(direction.size(0), direction.size(1))));
    torch::Tensor weight = buffer.part(buffer.master(), slot);
    weight.copy_(before[k].mul_(1.0 - lr * rest.options().weight_decay).add_(direction, -lr * scale));
  }
}

AdaptiveGradClipper::AdaptiveGradClipper(const Options& options) : options_(options) {
  if (options.buffer_size == 0) throw InputError("", "buffer_size", "must be at least 1");
  if (!(options.clip_percentile >= 0.0 && options.clip_percentile <= 100.0))
    throw InputError("", "clip_percentile", "must lie in [0, 100]");
  if (options.max_norm && !(*options.max_norm > 0.0)) throw InputError("", "max_norm", "must be positive");
  state_.buffer.assign(options.buffer_size, 0.0f);
  if (options.max_norm) state_.threshold = *options.max_norm;
}

double AdaptiveGradClipper::update(double norm) {
  // Not std::min: a NaN must reach the gradients, so that the update is seen to be bad.
  const double ratio = state_.threshold / (norm + 1e-6);
  const double factor = ratio > 1.0 ? 1.0 : ratio;
  if (!std::isfinite(norm)) return factor;
  state_.buffer[state_.pointer] = static_cast<float>(norm);
  state_.pointer = (state_.pointer + 1) % options_.buffer_size;
  state_.length = std::min(state_.length + 1, options_.buffer_size);
  if (state_.length == options_.buffer_size) {
    state_.threshold = percentile(state_.buffer, options_.clip_percentile);
    if (options_.max_norm) state_.threshold = std::min(state_.threshold, *options_.max_norm);
  }
  return factor;
}

void AdaptiveGradClipper::restore(const State& state) {
  if (state.buffer.size() != options_.buffer_size || state.pointer >= options_.buffer_size ||
      state.length > options_.buffer_size) {
    throw InputError("", "grad_clip",
                     "saved with a buffer of " + std::to_string(state.buffer.size()) + " norms, configured with " +
                         std::to_string(options_.buffer_size));
  }
  state_ = state;
  // The limit may have changed since.
  if (!options_.max_norm) return;
  const bool is_full = state_.length == options_.buffer_size;
  state_.threshold = is_full ? std::min(state_.threshold, *options_.max_norm) : *options_.max_norm;
}

void RecoveryPoint::before_update(std::int64_t step, const torch::Tensor& master) {
  if (step % kEvery == 0 && all_finite(master)) restore(step, master);
}

bool RecoveryPoint::after_update(std::int64_t step, torch::Tensor master) const {
  const torch::NoGradGuard no_grad;
  if (all_finite(master)) return false;
  if (step_ < 0) {
    throw Error("step " + std::to_string(step) +
                ": the update left weights that are not finite, and there are no earlier ones to go back to");
  }
  master.copy_(master_);
  return true;
}

void RecoveryPoint::restore(std::int64_t step, const torch::Tensor& master) {
  const torch::NoGradGuard no_grad;
  if (master_.defined()) {
    master_.copy_(master);
  } else {
    master_ = master.detach().clone();
  }
  step_ = step;
}

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
  result.lr = options_.schedule(options_.optimizer.lr, step);
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
    if (options_.loss_scaling) log_scale += options_.fp16_scale_growth;
  } else {
    log_scale = std::max(log_scale - 1.0, kLowestLogScale);
  }
  result.restored = recovery.after_update(step, buffer_.master());
  if (result.restored) buffer_.publish();
  const auto n = static_cast<double>(step);
  ema.update(buffer_.master(), options_.ema_warm_up ? (1.0 + n) / (10.0 + n) : 1.0);
  return result;
}

}  // namespace anigen::train
