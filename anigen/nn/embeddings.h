#pragma once
#include <cstdint>

#include "anigen/nn/host_tensor.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// Sinusoidal embedding of integer coordinates: per axis the sines then the cosines of c · 10000^(−i/F), F =
/// ⌊⌊C/axes⌋/2⌋; axes in order, zero-padded to C (docs/reference/flows.md, 1.2).
/// @param coordinates [N, axes], integer or floating point @return [N, channels] fp32
Tensor absolute_position_embedding(const Tensor& coordinates, std::int64_t channels);

/// Cells (x, y, z) of a cubic grid as rows in row-major order, z fastest. [R³, 3] int64
Tensor grid_coordinates(std::int64_t resolution);

/// Sinusoidal features of continuous coordinates (docs/reference/autoencoders.md, 1.2): [x, sin(b_0 x), cos(b_0 x),
/// sin(b_1 x), …] with bands b = 2^linspace(0, max_log2, n). The exponents end at max_log2 itself, so with n bands they
/// are not the integers 0..n-1, and there is no factor π. No parameters.
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
  const Tensor& bands() const { return bands_.host(); }  ///< [n] fp32, on the CPU

 private:
  HostTensor bands_;
  bool include_input_;
};

/// [cos(t f_i), sin(t f_i)] with f_i = exp(−ln(10000) i / (width/2)), cosines first (docs/reference/flows.md, 1.2); an
/// odd width ends with a zero. @param t [B] fp32, already multiplied by 1000 @return [B, width] fp32
Tensor timestep_features(const Tensor& t, std::int64_t width = 256);

/// timestep_features · Linear · SiLU · Linear, always in fp32. Keys `mlp.{0,2}.*`.
class TimestepEmbedderImpl : public torch::nn::Module {
 public:
  explicit TimestepEmbedderImpl(std::int64_t channels, std::int64_t frequency_channels = 256);
  Tensor forward(const Tensor& t);  ///< @param t [B] @return [B, channels]
  Linear first = nullptr, second = nullptr;

 private:
  std::int64_t frequency_channels_;
};
TORCH_MODULE(TimestepEmbedder);

/// [sin(x 2^k π), cos(x 2^k π)] for k = 0 … bands − 1 with x = clamp(n / most, 0, 1), sines first. In fp16 the
/// frequencies and the arguments are rounded as in the published system, which trains with them; at 2⁵π that moves an
/// argument by up to 1/32. bf16 would move it by a quarter, so every other dtype gets features formed in fp32.
/// @param joints_num [B] numbers of joints @param most above 0 @return [B, 2 bands]
torch::Tensor joint_count_features(const torch::Tensor& joints_num, std::int64_t most, std::int64_t bands,
                                   torch::Dtype dtype);

/// Number of joints of an asset, as an addition to the time embedding of a stream (docs/reference/flows.md, 2.4):
/// joint_count_features · Linear · SiLU · Linear; counts of 0 and below stand for no wish and give a learned vector
/// instead. Keys `0.*`, `2.*`; the vector belongs to the model, under a name of its own.
class JointCountEmbedderImpl : public torch::nn::Module {
 public:
  JointCountEmbedderImpl(std::int64_t channels, std::int64_t most, std::int64_t bands);
  /// @param joints_num [B] @param unconditional [channels] @return [B, channels] of the dtype of the layers
  torch::Tensor forward(const torch::Tensor& joints_num, const torch::Tensor& unconditional);

 private:
  std::int64_t most_, bands_;
  Linear first_ = nullptr, second_ = nullptr;
};
TORCH_MODULE(JointCountEmbedder);

}  // namespace anigen::nn
