#pragma once
#include "anigen/nn/torch.h"
#include "anigen/sparse/tap_plan.h"

namespace anigen::sparse {

using torch::Tensor;

/// out += what the plan says, in the dtype of `out`. Never holds more than a block of rows besides the arguments.
/// @param neighbours [27, N] int32, device of `in` @param in [N · from_children, Cin] @param matrices [M, Cin, Cout],
/// any strides @param out [N · to_children, Cout], contiguous
void add_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                     Tensor& out);

/// The gradient of the matrices for a gradient of `out`. @param slopes [N · to_children, Cout] @return [M, Cin, Cout]
/// in the type that sums of their type are formed in (nn::accumulation_dtype)
Tensor tap_correlation(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes);

/// The same on a CPU, all in fp32 or all in fp64: own kernels that read rows where they lie. The result has the same
/// bits for any number of threads.
void add_cpu_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                         Tensor& out);
Tensor cpu_tap_correlation(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes);

/// Whether add_bf16_tap_product() takes these on this CPU: bf16 rows, matrices of suitable sizes, AVX512-BF16.
bool prefers_bf16_tap_product(const Tensor& in, const Tensor& matrices);
/// add_cpu_tap_product() with `in` in bf16 and the matrices rounded to it, multiplied exactly and added up in fp32.
/// @param out fp32
void add_bf16_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                          Tensor& out);

/// The same by tensor operations on any device. Products are formed in the dtype of `in`, and added up in that of
/// `out`.
void add_tensor_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                            Tensor& out);
Tensor tensor_tap_correlation(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes);

}  // namespace anigen::sparse
