#pragma once
#include "anigen/nn/linear.h"

namespace anigen::nn {

/// What a model's constructor leaves in its parameters.
enum class Init {
  kPublished,  ///< the published initial values, drawn from torch's default generator (seed it with torch::manual_seed)
  kNone        ///< nothing: memory is reserved but not written; load every tensor (strictly) before use
};

/// Xavier-uniform weights and zero biases for every Linear below `module` (reference autoencoders.md, 1.3 and 3.10). Of
/// a low-rank addition `lora_A` becomes zero and `lora_B` 0.01 · N(0, 1) (reference flows-and-pipeline.md, 1.8).
void xavier_uniform_linears(torch::nn::Module& module);

/// Kaiming-uniform weights with gain 1 and the fan-in, |w| <= sqrt(3 / in), and zero biases for every Linear below
/// `module` (reference autoencoders.md, 2.3).
void kaiming_uniform_linears(torch::nn::Module& module);

/// PyTorch's default for every Conv3d below `module`: weights and biases uniform in ± 1 / sqrt(fan-in) (the
/// Kaiming-uniform rule with a = sqrt(5)).
void default_convolutions(torch::nn::Module& module);

/// Ones and zeros for the weight and the bias of every AffineLayerNorm and VolumeNorm below `module`, ones for the
/// gamma of every MultiHeadRmsNorm.
void default_norms(torch::nn::Module& module);

/// Weight ~ N(0, std²), zero bias: the layers of a timestep embedder (reference flows-and-pipeline.md, 1.7).
void normal_linear(LinearImpl& linear, double std = 0.02);

/// Zeros in every parameter of this module and those below.
void zero_parameters(torch::nn::Module& module);

/// Base of convolutions that are defined above nn (sparse::SubmanifoldKernel): fp16 conversion concerns them too.
class Convolution {
 public:
  virtual ~Convolution() = default;
};

/// True for linears and convolutions, dense and sparse: the published fp16 conversion changes their own parameters.
bool is_linear_or_convolution(const torch::nn::Module& module);

/// Converts the parameters of every Linear and convolution below `module`, in place; norms and bare parameters keep
/// their type (reference autoencoders.md, 0.4, "fp16 torso").
void cast_linears(torch::nn::Module& module, torch::Dtype dtype);

}  // namespace anigen::nn
