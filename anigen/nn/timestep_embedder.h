#pragma once
#include "anigen/nn/linear.h"

namespace anigen::nn {

/// [cos(t f_i), sin(t f_i)] with f_i = exp(−ln(10000) i / (width/2)), cosines first (reference flows-and-pipeline.md,
/// 1.2); an odd width ends with a zero. @param t [B] fp32, already multiplied by 1000 @return [B, width] fp32
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

}  // namespace anigen::nn
