#pragma once
#include "anigen/nn/init.h"
#include "anigen/sparse/sparse_tensor.h"

namespace anigen::sparse {

/// Submanifold convolution as rows: out[p] = bias + Σ W[:, i, j, k, :] · in[p + (i−1, j−1, k−1)], absent neighbours 0
/// (reference autoencoders.md, 0.3). Differentiable once in feats, weight and bias. Sums over taps are formed in fp32
/// for 16-bit types, on a CPU also those over channels. On a CPU the result and the gradients of feats and weight have
/// the same bits for any number of threads.
/// @param feats [N, Cin] @param weight [Cout, 3, 3, 3, Cin] @param bias [Cout] or undefined, all of one dtype
/// @return [N, Cout]
Tensor submanifold_convolution(const Support& support, const Tensor& feats, const Tensor& weight, const Tensor& bias);

/// submanifold_convolution on support.subdivided() of features that the eight children of each voxel share, without
/// repeating them, and with 8 products per child instead of 27 (the weights of taps that meet the same voxel are added
/// first). @param feats [N, Cin] @return [8 N, Cout]
Tensor subdivided_convolution(const Support& support, const Tensor& feats, const Tensor& weight, const Tensor& bias);

/// Parameters of a submanifold convolution, keys `weight` [out, k, k, k, in] and `bias` [out]; not initialised (see
/// nn::Linear). Kernel 3 or 1. With kernel 1 the stored weight is read as a matrix [in, out] without transposing it,
/// as the library behind the published checkpoints does (reference autoencoders.md, 0.3).
class SubmanifoldKernelImpl : public torch::nn::Module, public nn::Convolution {
 public:
  SubmanifoldKernelImpl(std::int64_t in_channels, std::int64_t out_channels, std::int64_t kernel);
  SparseTensor forward(const SparseTensor& x);
  Tensor weight, bias;
};
TORCH_MODULE(SubmanifoldKernel);

/// The same below the key `conv.*`, as published.
class SubmanifoldConv3dImpl : public torch::nn::Module {
 public:
  SubmanifoldConv3dImpl(std::int64_t in_channels, std::int64_t out_channels, std::int64_t kernel = 3);
  SparseTensor forward(const SparseTensor& x);
  SubmanifoldKernel conv = nullptr;
};
TORCH_MODULE(SubmanifoldConv3d);

/// Kaiming-uniform weights with a = √5 and biases uniform in ± 1/√fan-in, fan-in = Cin · k³, for every
/// SubmanifoldKernel below `module` (reference autoencoders.md, 3.10).
void default_submanifold_kernels(torch::nn::Module& module);

}  // namespace anigen::sparse
