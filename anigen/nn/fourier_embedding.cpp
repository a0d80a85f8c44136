#include "anigen/nn/fourier_embedding.h"

#include <cmath>

namespace anigen::nn {
namespace {

FourierEmbedding::Options published(std::int64_t num_freqs) {
  FourierEmbedding::Options options;
  options.num_freqs = num_freqs;
  options.max_freq_log2 = static_cast<double>(num_freqs);
  return options;
}

// Formed by the same fp32 operations as the published code: at the largest band one ulp moves the sine by 1e-4.
Tensor make_bands(const FourierEmbedding::Options& options) {
  if (options.log_sampling) return torch::pow(2.0, torch::linspace(0.0, options.max_freq_log2, options.num_freqs));
  return torch::linspace(1.0, std::exp2(options.max_freq_log2), options.num_freqs);
}

}  // namespace

FourierEmbedding::FourierEmbedding(const Options& options)
    : bands_(make_bands(options)), include_input_(options.include_input) {}

FourierEmbedding::FourierEmbedding(std::int64_t num_freqs) : FourierEmbedding(published(num_freqs)) {}

Tensor FourierEmbedding::operator()(const Tensor& x) const {
  const Tensor bands = bands_.to(x.options());
  const Tensor arguments = x.unsqueeze(-2) * bands.unsqueeze(-1);  // [..., n, d]
  // [..., n, 2, d] flattened gives sin(b_0 x), cos(b_0 x), sin(b_1 x), …
  const Tensor waves = torch::stack({arguments.sin(), arguments.cos()}, -2).flatten(-3);
  return include_input_ ? torch::cat({x, waves}, -1) : waves;
}

std::int64_t FourierEmbedding::width(std::int64_t dims) const {
  return dims * (2 * bands_.size(0) + (include_input_ ? 1 : 0));
}

}  // namespace anigen::nn
