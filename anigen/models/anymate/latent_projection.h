#pragma once
#include "anigen/models/anymate/blocks.h"

namespace anigen::models::anymate {

struct ProjectionWidths {
  std::int64_t in = 384, hidden_1 = 512, hidden_2 = 512, out = 768;
};

/// Point-BERT's tokens in the width of the decoders (reference anymate-baselines.md, 2.2): Linear · GELU · Linear ·
/// GELU · Linear. Keys `0.*`, `2.*`, `4.*`.
class TokenProjectionImpl : public torch::nn::Module {
 public:
  explicit TokenProjectionImpl(const ProjectionWidths& widths);
  Tensor forward(const Tensor& tokens);  ///< @param tokens [B, T, in] @return [B, T, out]

 private:
  nn::Linear first_ = nullptr, second_ = nullptr, third_ = nullptr;
};
TORCH_MODULE(TokenProjection);

/// The same, and a learned weighted sum of the tokens after it, for decoders of one vector. Keys `0.{0,2,4}.*` and
/// `1.{weight [1, T], bias}`.
class PooledProjectionImpl : public torch::nn::Module {
 public:
  PooledProjectionImpl(const ProjectionWidths& widths, std::int64_t tokens);
  Tensor forward(const Tensor& tokens);  ///< @param tokens [B, T, in] @return [B, out]

 private:
  TokenProjection each_ = nullptr;
  nn::Linear sum_ = nullptr;
};
TORCH_MODULE(PooledProjection);

}  // namespace anigen::models::anymate
