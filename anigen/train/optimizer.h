#pragma once
#include <torch/torch.h>

#include <array>
#include <cstdint>

namespace anigen::train {

/// AdamW (Loshchilov and Hutter 2019, algorithm 2, as torch.optim.AdamW computes it) over one flat fp32 vector; or
/// Adam, whose weight decay is part of the gradient. On the CPU one pass over memory; its result does not depend on the
/// number of threads.
class AdamW {
 public:
  struct Options {
    double lr = 1e-3;
    std::array<double, 2> betas{0.9, 0.999};
    double eps = 1e-8;
    double weight_decay = 1e-2;
    bool decoupled = true;  ///< false: Adam (Kingma and Ba 2015, as torch.optim.Adam)
  };

  /// @param parameters [P] fp32; only its size and device are used
  /// @throws InputError for options out of range
  AdamW(const torch::Tensor& parameters, const Options& options);

  /// parameters ← update, in place. @param gradients [P] fp32 @param gradient_factor multiplies every gradient
  /// (clipping) @param lr learning rate of this step
  void step(torch::Tensor parameters, const torch::Tensor& gradients, double gradient_factor, double lr);

  const Options& options() const { return options_; }

  /// Everything that options do not say: first and second moment [P] and the number of steps taken.
  torch::Tensor exp_avg, exp_avg_sq;
  std::int64_t steps = 0;

 private:
  Options options_;
};

}  // namespace anigen::train
