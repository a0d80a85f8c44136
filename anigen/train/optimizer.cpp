#include "anigen/train/optimizer.h"

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/kernel_form.h"

namespace anigen::train {
namespace {

struct Coefficients {
  float gradient, decay, l2, beta1, one_minus_beta1, beta2, one_minus_beta2, root_correction, eps, step_size;
};

ANIGEN_EXACT_KERNEL(void, adamw_pass,
                    (float* __restrict p, const float* __restrict g, float* __restrict m, float* __restrict v,
                     std::int64_t n, const Coefficients c),
                    (p, g, m, v, n, c)) {
  for (std::int64_t i = 0; i < n; ++i) {
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

}  // namespace

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

}  // namespace anigen::train
