#pragma once
#include <ATen/Parallel.h>
#include <torch/torch.h>
#include <torch/version.h>
#include <cstdint>

/// The only place that includes LibTorch. Everything that differs between the versions we build against (1.13 of
/// Debian 12, 2.x of Debian 13 and of PyTorch's own builds) is decided here, so that no other file tests a version.

/// True when this LibTorch is at least major.minor.
#define ANIGEN_TORCH_AT_LEAST(major, minor) \
  (TORCH_VERSION_MAJOR > (major) || (TORCH_VERSION_MAJOR == (major) && TORCH_VERSION_MINOR >= (minor)))

#if !ANIGEN_TORCH_AT_LEAST(1, 13)
#error "AniGen needs LibTorch 1.13 or newer"
#endif

#if AT_PARALLEL_OPENMP && !defined(_OPENMP)
#error "compile with OpenMP: without it at::parallel_for of this LibTorch runs on one thread"
#endif

namespace anigen::nn {

using torch::Tensor;
using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

/// The two 16-bit floating-point types, in which norms and softmax are not evaluated.
inline bool is_reduced_precision(torch::Dtype dtype) { return dtype == torch::kHalf || dtype == torch::kBFloat16; }

/// The type in which a sum over values of this type is formed: fp32 for 16-bit values, else the type itself.
inline torch::Dtype accumulation_dtype(torch::Dtype dtype) {
  return is_reduced_precision(dtype) ? torch::kFloat32 : dtype;
}

/// softmax(q kᵀ / √D + mask) v by one kernel of the library, for [B, H, ·, D]; LibTorch 2 and newer.
/// @param mask broadcast over [B, H, N, M], dtype of q; undefined for none
#if ANIGEN_TORCH_AT_LEAST(2, 0)
inline constexpr bool kHasFusedAttention = true;
inline Tensor fused_attention(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& mask = {}) {
  if (!mask.defined()) return at::scaled_dot_product_attention(q, k, v);
  return at::scaled_dot_product_attention(q, k, v, mask);
}
#else
inline constexpr bool kHasFusedAttention = false;
inline Tensor fused_attention(const Tensor& q, const Tensor&, const Tensor&, const Tensor& = {}) {
  TORCH_CHECK(kHasFusedAttention, "this LibTorch has no fused attention");
  return q;
}
#endif

/// A tensor of the host on a device. It goes through pinned memory, so that a GPU copies it in the order of its work
/// and the caller goes on; from pageable memory the caller would wait for all work that the GPU has been given.
inline Tensor to_device(const Tensor& host, torch::Device device) {
  if (device.is_cpu() || !host.is_cpu()) return host.to(device);
  const Tensor source = device.is_cuda() ? host.pin_memory() : host;
  return source.to(device, host.scalar_type(), /*non_blocking=*/true);
}

/// Tensors that a forward pass saved for a backward pass without a derivative of its own. @throws c10::Error under
/// create_graph, where `what` would miss terms of a second derivative
inline variable_list saved_once(const AutogradContext& context, const char* what) {
  TORCH_CHECK(!at::GradMode::is_enabled(), what,
              " can be differentiated once only: its backward pass, under create_graph, would miss terms");
  return context.get_saved_variables();
}

/// dtype of a tensor as torch::Dtype (Tensor::dtype() returns a TypeMeta).
inline torch::Dtype dtype_of(const Tensor& tensor) { return tensor.scalar_type(); }

}  // namespace anigen::nn
