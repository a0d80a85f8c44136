#pragma once
#include <torch/torch.h>

#include <cstdint>
#include <vector>

#include "anigen/train/optimizer.h"
#include "anigen/train/parameter_buffer.h"

namespace anigen::train {

/// Nearest semi-orthogonal matrix, approximately: five Newton–Schulz iterations with the quintic coefficients of
/// Jordan et al. 2024 ("Muon: an optimizer for hidden layers"). Singular values come out between about 0.7 and 1.2.
/// @param matrix [m, n] fp32 @return [m, n] fp32
torch::Tensor orthogonalize(const torch::Tensor& matrix);

/// Muon for weight matrices, AdamW for the rest (biases, embeddings, matrices with a side shorter than
/// min_side, such as first and last layers). The published trainer accepts the optimizer name `muon`, by way of a
/// package of its own (reference training-and-data.md, section 2.4); no published config uses it.
///
/// Update of a matrix: momentum of the gradient, Nesterov look-ahead, orthogonalised, times
/// lr · 0.2 · sqrt(max(m, n)) so that its root mean square is that of a typical AdamW update and one learning
/// rate serves both (Liu et al. 2025, "Muon is scalable for LLM training", eq. 4).
class Muon {
 public:
  struct Options {
    double momentum = 0.95;
    std::int64_t min_side = 16;
  };

  /// @throws InputError for options out of range
  Muon(const ParameterBuffer& buffer, const Options& options);

  /// Updates buffer.master() from buffer.gradient(). @param rest updates what is no matrix; its weight decay holds for
  /// both @param gradient_factor multiplies every gradient (clipping)
  void step(ParameterBuffer& buffer, AdamW& rest, double gradient_factor, double lr);

  /// All of the state that options do not say: [P], zero where AdamW is used.
  torch::Tensor momentum;

 private:
  Options options_;
  std::vector<std::size_t> matrices_;  // slots that Muon updates
};

}  // namespace anigen::train
