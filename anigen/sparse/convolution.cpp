#include "anigen/sparse/convolution.h"

#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/nn/shape_text.h"
#include "anigen/sparse/tap_function.h"

namespace anigen::sparse {
namespace {

constexpr std::int64_t kKernel = 3, kKernelTaps = kKernel * kKernel * kKernel;

void check_convolution(const Support& support, const Tensor& feats, const Tensor& weight, const Tensor& bias) {
  TORCH_CHECK(weight.dim() == 5 && weight.size(1) == kKernel && weight.size(2) == kKernel &&
                  weight.size(3) == kKernel && feats.dim() == 2 && feats.size(0) == support.size() &&
                  feats.size(1) == weight.size(4) && weight.size(0) > 0 && weight.size(4) > 0,
              "sparse convolution at ", support.size(), " voxels of features ", nn::shape_text(feats), " by a weight ",
              nn::shape_text(weight));
  TORCH_CHECK(!bias.defined() || (bias.dim() == 1 && bias.size(0) == weight.size(0)), "sparse convolution by a weight ",
              nn::shape_text(weight), " and a bias ", nn::shape_text(bias));
  TORCH_CHECK(nn::dtype_of(feats) == nn::dtype_of(weight) && feats.is_floating_point(),
              "sparse convolution of features of type ", feats.dtype(), " by a weight of type ", weight.dtype());
}

Tensor widened(const Tensor& x) { return x.to(nn::accumulation_dtype(nn::dtype_of(x))); }

Tensor wide_bias(const Tensor& bias, const Tensor& weight) {
  return widened(bias.defined() ? bias : torch::zeros({weight.size(0)}, weight.options()));
}

// [Cout, 3, 3, 3, Cin] → [64, Cin, Cout] of subdivision_plan: along each axis, by the bit of the child, the sum of the
// taps that meet the lower and of those that meet the upper one of its two coarse voxels.
Tensor folded_taps(const Tensor& weight) {
  const Tensor fold =
      torch::tensor({1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0}, weight.options()).view({2, 2, 3});
  Tensor folded = weight;  // [Cout, x, y, z, Cin] → [bit x, side x, Cout, y, z, Cin] → …
  folded = torch::tensordot(fold, folded, {2}, {1});
  folded = torch::tensordot(fold, folded, {2}, {3});
  folded = torch::tensordot(fold, folded, {2}, {5});
  // Now [bit z, side z, bit y, side y, bit x, side x, Cout, Cin].
  return folded.permute({4, 2, 0, 5, 3, 1, 7, 6}).reshape({64, weight.size(4), weight.size(0)});
}

}  // namespace

Tensor submanifold_convolution(const Support& support, const Tensor& feats, const Tensor& weight, const Tensor& bias) {
  check_convolution(support, feats, weight, bias);
  const Tensor taps = widened(weight).reshape({weight.size(0), kKernelTaps, weight.size(4)}).permute({1, 2, 0});
  return tap_function(feats, taps, wide_bias(bias, weight), support.neighbours_on(feats.device()), false);
}

Tensor subdivided_convolution(const Support& support, const Tensor& feats, const Tensor& weight, const Tensor& bias) {
  check_convolution(support, feats, weight, bias);
  support.subdivided();  // whether it can be
  return tap_function(feats, folded_taps(widened(weight)), wide_bias(bias, weight),
                      support.neighbours_on(feats.device()), true);
}

SubmanifoldKernelImpl::SubmanifoldKernelImpl(std::int64_t in_channels, std::int64_t out_channels, std::int64_t kernel) {
  if (kernel != 1 && kernel != kKernel) {
    throw NotSupportedError("", "", "a sparse convolution with a kernel of " + std::to_string(kernel) + " voxels");
  }
  weight = register_parameter("weight", torch::empty({out_channels, kernel, kernel, kernel, in_channels}));
  bias = register_parameter("bias", torch::empty({out_channels}));
}

SparseTensor SubmanifoldKernelImpl::forward(const SparseTensor& x) {
  if (weight.size(1) == kKernel) return x.with(submanifold_convolution(*x.support, x.feats, weight, bias));
  const Tensor matrix = weight.reshape({weight.size(4), weight.size(0)});
  if (x.feats.is_cpu() && nn::dtype_of(x.feats) == torch::kHalf) {  // not every LibTorch multiplies these
    return x.with(torch::addmm(widened(bias), widened(x.feats), widened(matrix)).to(torch::kHalf));
  }
  return x.with(torch::addmm(bias, x.feats, matrix));
}

SubmanifoldConv3dImpl::SubmanifoldConv3dImpl(std::int64_t in_channels, std::int64_t out_channels, std::int64_t kernel) {
  conv = register_module("conv", SubmanifoldKernel(in_channels, out_channels, kernel));
}

SparseTensor SubmanifoldConv3dImpl::forward(const SparseTensor& x) { return conv->forward(x); }

void default_submanifold_kernels(torch::nn::Module& module) {
  module.apply([](torch::nn::Module& part) {
    auto* kernel = part.as<SubmanifoldKernelImpl>();
    if (kernel == nullptr) return;
    const double fan_in = static_cast<double>(kernel->weight.numel() / kernel->weight.size(0));
    const double bound = 1.0 / std::sqrt(fan_in);  // √(6 / ((1 + a²) fan-in)) with a = √5
    torch::nn::init::uniform_(kernel->weight, -bound, bound);
    torch::nn::init::uniform_(kernel->bias, -bound, bound);
  });
}

}  // namespace anigen::sparse
