#include "anigen/train/ema.h"

#include "anigen/core/error.h"
#include "anigen/core/kernel_form.h"

namespace anigen::train {
namespace {

ANIGEN_EXACT_KERNEL(void, ema_pass,
                    (float* __restrict average, const float* __restrict master, std::int64_t n, float keep, float take),
                    (average, master, n, keep, take)) {
  for (std::int64_t i = 0; i < n; ++i) average[i] = average[i] * keep + master[i] * take;
}

}  // namespace

Ema::Ema(const std::vector<double>& rates, const torch::Tensor& master) : rates_(rates) {
  for (const double rate : rates) {
    if (!(rate >= 0.0 && rate < 1.0)) throw InputError("", "ema_rate", "every rate must lie in [0, 1)");
    averages_.push_back(master.detach().clone());
  }
}

void Ema::update(const torch::Tensor& master) {
  torch::NoGradGuard no_grad;
  for (std::size_t i = 0; i < rates_.size(); ++i) {
    torch::Tensor& average = averages_[i];
    const double rate = rates_[i];
    if (average.is_cpu() && average.scalar_type() == torch::kFloat32) {
      ema_pass(average.data_ptr<float>(), master.data_ptr<float>(), average.numel(), static_cast<float>(rate),
               static_cast<float>(1.0 - rate));
    } else {
      average.mul_(rate).add_(master, 1.0 - rate);
    }
  }
}

}  // namespace anigen::train
