#pragma once
#include <cstdint>

#include "anigen/nn/linear.h"

namespace anigen::models {

/// [sin(x 2^k π), cos(x 2^k π)] for k = 0 … bands − 1 with x = clamp(n / most, 0, 1), sines first. In fp16 the
/// frequencies and the arguments are rounded as in the published system, which trains with them; at 2⁵π that moves an
/// argument by up to 1/32. bf16 would move it by a quarter, so every other dtype gets features formed in fp32.
/// @param joints_num [B] numbers of joints @param most above 0 @return [B, 2 bands]
torch::Tensor joint_count_features(const torch::Tensor& joints_num, std::int64_t most, std::int64_t bands,
                                   torch::Dtype dtype);

/// How many joints an asset shall have, as an addition to the time embedding of a stream (reference
/// flows-and-pipeline.md, 2.6): joint_count_features · Linear · SiLU · Linear; counts of 0 and below stand for no wish
/// and give a learned vector instead. Keys `0.*`, `2.*`; the vector belongs to the model, under a name of its own.
class JointCountEmbedderImpl : public torch::nn::Module {
 public:
  JointCountEmbedderImpl(std::int64_t channels, std::int64_t most, std::int64_t bands);
  /// @param joints_num [B] @param unconditional [channels] @return [B, channels] of the dtype of the layers
  torch::Tensor forward(const torch::Tensor& joints_num, const torch::Tensor& unconditional);

 private:
  std::int64_t most_, bands_;
  nn::Linear first_ = nullptr, second_ = nullptr;
};
TORCH_MODULE(JointCountEmbedder);

}  // namespace anigen::models
