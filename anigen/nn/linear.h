#pragma once
#include <memory>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::nn::kernels {
struct Int8Matrix;
}

namespace anigen::nn {

/// Low-rank addition to a linear map (docs/reference/flows.md, 1.5): + scale · (x A) B.
struct Lora {
  std::int64_t rank = 0;  ///< 0: none
  double scale = 0.1;     ///< not divided by the rank, and not in a checkpoint
};

/// Affine map of the last axis with parameters `weight` [out, in] and `bias` [out], like torch::nn::Linear, but
/// without drawing initial values: the whole model is initialised once (see init.h) or filled from a checkpoint.
/// Building a published-size model only to list or load its parameters therefore touches no memory. With Lora also
/// `lora_A` [in, rank] and `lora_B` [rank, out].
class LinearImpl : public torch::nn::Module {
 public:
  LinearImpl(std::int64_t in_features, std::int64_t out_features, bool with_bias = true, const Lora& lora = {});

  /// @param x [..., in] of the dtype of the weight @return [..., out]
  Tensor forward(const Tensor& x);

  /// Rounds the weight to 8-bit integers, for good (see nn::quantize()). The parameter keeps its dtype and no numbers.
  void quantize();
  bool is_quantized() const { return quantized_ != nullptr; }

  Tensor weight, bias, lora_A, lora_B;

 private:
  double lora_scale_;
  std::shared_ptr<const kernels::Int8Matrix> quantized_;
};
TORCH_MODULE(Linear);

/// Linear(in→hidden) · gelu (tanh form) · Linear(hidden→out), with keys `0.{weight,bias}` and `2.{weight,bias}`
/// (docs/reference/autoencoders.md, 1.2).
class MlpImpl : public torch::nn::Module {
 public:
  MlpImpl(std::int64_t in_features, std::int64_t hidden_features, std::int64_t out_features);
  Tensor forward(const Tensor& x);
  torch::Dtype dtype() const { return dtype_of(first_->weight); }

 private:
  Linear first_ = nullptr, second_ = nullptr;
};
TORCH_MODULE(Mlp);

/// True when bf16 products on this CPU are better done in fp32: LibTorch then has no bf16 kernel of its own but a loop
/// more than ten times slower (no oneDNN, or no AVX-512). @param x, weight of a linear layer
bool prefers_widened_linear(const Tensor& x, const Tensor& weight);

/// torch::linear for bf16 on a CPU: inputs widened to fp32, products and sums in fp32, the result rounded once. Keeps
/// only the bf16 tensors for the backward pass. @param x [..., in] @param weight [out, in] @param bias [out] or
/// undefined
Tensor widened_linear(const Tensor& x, const Tensor& weight, const Tensor& bias);

/// Every value rounded to the nearest bf16 number, as fp32: a factor of an emulated product
/// (nn/kernels/mixed_products.h). Passes no gradient.
Tensor rounded_factor(const Tensor& x);

/// True when a linear layer is computed in mixed precision (nn/kernels/mixed_products.h): neither width below 16, and
/// rows enough.
bool prefers_mixed_linear(const Tensor& x, const Tensor& weight);

/// torch::linear of fp32 tensors with factors rounded to bf16 and sums in fp32, its gradients likewise. Can be
/// differentiated once; bits do not depend on the number of threads, unless emulated. @param bias [out] or undefined
Tensor mixed_linear(const Tensor& x, const Tensor& weight, const Tensor& bias);

/// torch::linear in the way that is fastest for these tensors: mixed_linear, widened_linear, or LibTorch's own.
/// @param x [..., in] @param weight [out, in] @param bias [out] or undefined @return [..., out]
Tensor linear(const Tensor& x, const Tensor& weight, const Tensor& bias = {});

/// x ⊙ gamma with one learned factor per channel (Touvron et al. 2021, CaiT). Key `gamma` [C], not initialised: the
/// model is filled from a checkpoint (see Linear).
class LayerScaleImpl : public torch::nn::Module {
 public:
  explicit LayerScaleImpl(std::int64_t channels) { gamma = register_parameter("gamma", torch::empty({channels})); }

  /// @param x [..., C] @return [..., C]
  Tensor forward(const Tensor& x) { return x * gamma; }

  Tensor gamma;
};
TORCH_MODULE(LayerScale);

/// Layers as one module with the keys `0.*`, `1.*`, …
template <typename Layer>
torch::nn::ModuleList module_list(const std::vector<Layer>& layers) {
  torch::nn::ModuleList list;
  for (const Layer& layer : layers) list->push_back(layer);
  return list;
}

/// gelu in its tanh form, 0.5 x (1 + tanh(√(2/π)(x + 0.044715 x³))), the only form the published models use
/// (docs/reference/autoencoders.md, 1.2). On fp32 tensors in CPU memory it is evaluated as x · sigmoid(2 √(2/π)(…)),
/// the same function, by a vectorised exponential: several times faster than LibTorch's, which calls tanh, and this
/// function takes a third of a training step of small models. Agrees with it to a few units in the last place. Can be
/// differentiated once.
Tensor gelu_tanh(const Tensor& x);

/// gelu(x W1ᵀ + b1) W2ᵀ + b2, as one operation on many rows in CPU memory. A few hundred rows at a time pass through
/// both layers while their hidden values stay in the cache; the backward pass computes these again instead of storing
/// them. Against separate layers this spares eight times the memory traffic of the input (hidden width four, written
/// and read back), and the page faults of allocating it. Can be differentiated once.
/// @param x [N, in] fp32 @param w1 [hidden, in] @param b1 [hidden] @param w2 [out, hidden] @param b2 [out] @return [N,
/// out]
Tensor fused_mlp(const Tensor& x, const Tensor& w1, const Tensor& b1, const Tensor& w2, const Tensor& b2);

/// True when fused_mlp applies to this input and is the faster way.
bool prefers_fused_mlp(const Tensor& x, const Tensor& w1);

}  // namespace anigen::nn
