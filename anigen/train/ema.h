#pragma once
#include <torch/torch.h>

#include <vector>

namespace anigen::train {

/// Exponential moving averages of the flat parameter vector at one or several rates: ema ← r·ema + (1 − r)·master
/// after every step, also after a skipped update, without warm-up (reference training-and-data.md, section 2.4, 8).
/// Make it after warm starts: the published trainer averages from the random initialisation instead, a defect.
class Ema {
 public:
  /// @param rates each in [0, 1) @param master [P] fp32; every average starts as a copy @throws InputError
  Ema(const std::vector<double>& rates, const torch::Tensor& master);

  void update(const torch::Tensor& master);

  const std::vector<double>& rates() const { return rates_; }
  /// [P] fp32, one per rate; writable for resuming.
  std::vector<torch::Tensor>& averages() { return averages_; }
  const std::vector<torch::Tensor>& averages() const { return averages_; }

 private:
  std::vector<double> rates_;
  std::vector<torch::Tensor> averages_;
};

}  // namespace anigen::train
