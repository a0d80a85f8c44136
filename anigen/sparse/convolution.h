#pragma once
#include <cstdint>
#include <vector>

#include "anigen/nn/init.h"
#include "anigen/nn/torch.h"
#include "anigen/sparse/support.h"

namespace anigen::sparse {

/// One product of a convolution; see TapPlan.
struct TapLink {
  std::int64_t tap, from_child, to_child, matrix;

  bool operator==(const TapLink& other) const {
    return tap == other.tap && from_child == other.from_child && to_child == other.to_child && matrix == other.matrix;
  }
};

/// Links of a convolution over the neighbours of N voxels: rows and matrices. For every link and every row r
/// whose neighbour q = neighbours[tap][r] exists:
///   out[r · to_children + to_child] += in[q · from_children + from_child] · W[matrix]
/// No two links have the same matrix, and links of one to_child follow one another.
struct TapPlan {
  std::int64_t from_children = 1, to_children = 1;
  std::vector<TapLink> links;

  std::int64_t matrices() const { return static_cast<std::int64_t>(links.size()); }
};

/// A 3×3×3 convolution: matrix t is that of tap t (Support::neighbours).
TapPlan submanifold_plan();

/// A 3×3×3 convolution on the subdivided support of features that eight children share. The 27 neighbours of a child
/// lie in eight voxels of the coarse support, so that eight products with sums of weights are enough. Matrix (child · 8
/// + side): `side` counts these voxels, x slowest, along each axis the lower one first.
TapPlan subdivision_plan();

/// The way back, from rows of the output to rows of the input, each matrix to be transposed: the neighbour relation is
/// symmetric, tap t of p is q where tap 26 − t of q is p.
TapPlan reversed(const TapPlan& plan);

/// out += what the plan says, in the dtype of `out`. Never holds more than a block of rows besides the arguments.
/// @param neighbours [27, N] int32, device of `in` @param in [N · from_children, Cin] @param matrices [M, Cin, Cout],
/// any strides @param out [N · to_children, Cout], contiguous @param mixed fp32 factors are rounded to bf16
/// (nn/kernels/mixed_products.h) where the sizes allow it
void add_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                     Tensor& out, bool mixed = false);

/// The gradient of the matrices for a gradient of `out`. @param slopes [N · to_children, Cout] @return [M, Cin, Cout]
/// in the type that sums of their type are formed in (nn::accumulation_dtype)
Tensor tap_correlation(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes,
                       bool mixed = false);

/// As above, on a CPU, all in fp32 or all in fp64: own kernels that read rows where they lie. The result has the same
/// bits for any number of threads.
void add_cpu_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                         Tensor& out);
Tensor cpu_tap_correlation(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes,
                           bool mixed = false);

/// True when add_bf16_tap_product() takes such matrices on this CPU: suitable sizes, AVX512-BF16.
bool fits_bf16_tap_product(const Tensor& matrices);
/// add_cpu_tap_product() with `in` in bf16 and the matrices rounded to it, multiplied exactly and added up in fp32.
/// @param out fp32
void add_bf16_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                          Tensor& out);

/// As above, by tensor operations on any device. Products are formed in the dtype of `in`, and added up in that of
/// `out`.
void add_tensor_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                            Tensor& out);
Tensor tensor_tap_correlation(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes);

/// Submanifold convolution as rows: out[p] = bias + Σ W[:, i, j, k, :] · in[p + (i−1, j−1, k−1)], absent neighbours 0
/// (docs/reference/autoencoders.md, 1.3). Differentiable once in feats, weight and bias. Sums over taps are formed in
/// fp32 for 16-bit types, on a CPU also those over channels. On a CPU the result and the gradients of feats and weight
/// have the same bits for any number of threads.
/// @param feats [N, Cin] @param weight [Cout, 3, 3, 3, Cin] @param bias [Cout] or undefined, all of one dtype
/// @return [N, Cout]
Tensor submanifold_convolution(const Support& support, const Tensor& feats, const Tensor& weight, const Tensor& bias);

/// submanifold_convolution on support.subdivided() of features that the eight children of each voxel share, without
/// repeating them, and with 8 products per child instead of 27 (the weights of taps that meet the same voxel are added
/// first). @param feats [N, Cin] @return [8 N, Cout]
Tensor subdivided_convolution(const Support& support, const Tensor& feats, const Tensor& weight, const Tensor& bias);

/// Parameters of a submanifold convolution, keys `weight` [out, k, k, k, in] and `bias` [out]; not initialised (see
/// nn::Linear). Kernel 3 or 1. With kernel 1 the stored weight is read as a matrix [in, out] without transposing it,
/// as the library behind the published checkpoints does (docs/reference/autoencoders.md, 1.3).
class SubmanifoldKernelImpl : public torch::nn::Module, public nn::Convolution {
 public:
  SubmanifoldKernelImpl(std::int64_t in_channels, std::int64_t out_channels, std::int64_t kernel);
  SparseTensor forward(const SparseTensor& x);
  Tensor weight, bias;
};
TORCH_MODULE(SubmanifoldKernel);

/// As above, below the key `conv.*`, as published.
class SubmanifoldConv3dImpl : public torch::nn::Module {
 public:
  SubmanifoldConv3dImpl(std::int64_t in_channels, std::int64_t out_channels, std::int64_t kernel = 3);
  SparseTensor forward(const SparseTensor& x);
  SubmanifoldKernel conv = nullptr;
};
TORCH_MODULE(SubmanifoldConv3d);

/// Kaiming-uniform weights with a = √5 and biases uniform in ± 1/√fan-in, fan-in = Cin · k³, for every
/// SubmanifoldKernel below `module` (docs/reference/autoencoders.md, 1.6).
void default_submanifold_kernels(torch::nn::Module& module);

}  // namespace anigen::sparse
