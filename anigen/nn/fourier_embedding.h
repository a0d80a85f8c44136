#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// Sinusoidal features of continuous coordinates (reference autoencoders.md, 0.2, "Fourier embedding"):
/// [x, sin(b_0 x), cos(b_0 x), sin(b_1 x), …] with bands b = 2^linspace(0, max_log2, n). The exponents end at
/// max_log2 itself, so with n bands they are not the integers 0..n-1, and there is no factor π. No parameters.
class FourierEmbedding {
 public:
  struct Options {
    std::int64_t num_freqs = 10;
    double max_freq_log2 = 10;  ///< the published models pass num_freqs here
    bool log_sampling = true;   ///< false: bands are spaced evenly between 2^0 and 2^max_log2
    bool include_input = true;  ///< the raw coordinates come first
  };
  explicit FourierEmbedding(const Options& options);
  /// The published form: n bands up to 2^n, logarithmic, raw input first.
  explicit FourierEmbedding(std::int64_t num_freqs);

  /// @param x [..., d] @return [..., width(d)], dtype of x; the bands are fp32 values whatever the dtype
  Tensor operator()(const Tensor& x) const;
  std::int64_t width(std::int64_t dims) const;
  const Tensor& bands() const { return bands_; }  ///< [n] fp32, on the CPU

 private:
  Tensor bands_;
  bool include_input_;
};

}  // namespace anigen::nn
