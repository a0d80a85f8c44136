#include "anigen/nn/linear.h"

#include <ATen/Context.h>
#include <ATen/Parallel.h>
#include <algorithm>

#include "anigen/core/kernel_form.h"
#include "anigen/nn/int8_linear.h"
#include "anigen/nn/kernels/activations.h"
#include "anigen/nn/kernels/aligned_vector.h"
#include "anigen/nn/kernels/mixed_products.h"
#include "anigen/nn/kernels/tiles.h"
#include "anigen/nn/profile.h"

namespace anigen::nn {

LinearImpl::LinearImpl(std::int64_t in_features, std::int64_t out_features, bool with_bias, const Lora& lora)
    : lora_scale_(lora.scale) {
  weight = register_parameter("weight", torch::empty({out_features, in_features}));
  if (with_bias) bias = register_parameter("bias", torch::empty({out_features}));
  if (lora.rank == 0) return;
  lora_A = register_parameter("lora_A", torch::empty({in_features, lora.rank}));
  lora_B = register_parameter("lora_B", torch::empty({lora.rank, out_features}));
}

Tensor LinearImpl::forward(const Tensor& x) {
  const Tensor y = is_quantized() ? int8_linear(x, *quantized_, bias) : linear(x, weight, bias);
  return lora_A.defined() ? y.add(torch::matmul(torch::matmul(x, lora_A), lora_B), lora_scale_) : y;
}

void LinearImpl::quantize() {
  const Tensor wide = weight.detach().to(torch::kFloat32).contiguous();
  quantized_ = std::make_shared<const kernels::Int8Matrix>(
      kernels::round_to_int8(wide.data_ptr<float>(), wide.size(0), wide.size(1)));
  weight.set_data(torch::empty({0}, weight.options()));
}

MlpImpl::MlpImpl(std::int64_t in_features, std::int64_t hidden_features, std::int64_t out_features) {
  first_ = register_module("0", Linear(in_features, hidden_features));
  second_ = register_module("2", Linear(hidden_features, out_features));
}

Tensor MlpImpl::forward(const Tensor& x) {
  if (!first_->is_quantized() && prefers_fused_mlp(x, first_->weight))
    return fused_mlp(x, first_->weight, first_->bias, second_->weight, second_->bias);
  return second_->forward(gelu_tanh(first_->forward(x)));
}

namespace {

// True if LibTorch multiplies bf16 numbers well here, and ANIGEN_KERNELS asks for nothing narrower.
bool has_bf16_linear() {
#if defined(__x86_64__)
  static const bool has = at::hasMKLDNN() && __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl") &&
                          __builtin_cpu_supports("avx512dq");
  return has && kernel_form() >= KernelForm::kAvx512;
#else
  static const bool has = at::hasMKLDNN();
  return has;
#endif
}

// x wᵀ in fp32.
class WideProduct : public torch::autograd::Function<WideProduct> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& x, const Tensor& weight) {
    context->save_for_backward({x, weight});
    return torch::matmul(x.to(torch::kFloat32), weight.to(torch::kFloat32).t());
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const auto saved = context->get_saved_variables();
    const Tensor &x = saved[0], &weight = saved[1];
    const Tensor dy = gradients[0].reshape({-1, weight.size(0)});
    const Tensor dx = torch::mm(dy, weight.to(torch::kFloat32)).to(x.scalar_type()).view(x.sizes());
    const Tensor rows = x.to(torch::kFloat32).reshape({-1, weight.size(1)});
    return {dx, torch::mm(dy.t(), rows).to(weight.scalar_type())};
  }
};

// Rows that are rounded before they are multiplied, and fewer than which a product of the library is as fast.
constexpr std::int64_t kMixedRows = 96, kFewestMixedRows = 32;

// Widths are filled up to a multiple of 16, which would be most of a narrower product.
constexpr std::int64_t kFewestMixedWidth = 16;

// Widths that products have inside; what is beyond those of the tensors is 0.
std::int64_t padded(std::int64_t width) {
  constexpr std::int64_t kVector = 16;
  return (width + kVector - 1) / kVector * kVector;
}

Tensor padded(const Tensor& matrix) {
  const std::int64_t below = padded(matrix.size(0)) - matrix.size(0), right = padded(matrix.size(1)) - matrix.size(1);
  return below + right == 0 ? matrix.contiguous() : torch::constant_pad_nd(matrix, {0, right, 0, below}).contiguous();
}

// x · matrix + bias, rows shared among the threads. @param x [M, K] with adjacent columns @param matrix [K, N], both
// widths padded
// @param bias nullptr: none @return [M, N]
Tensor mixed_product(const Tensor& x, const kernels::StridedMatrix& matrix, std::int64_t width, const float* bias) {
  const std::int64_t rows = x.size(0), in_width = x.size(1), stride = x.stride(0);
  const std::int64_t depth = padded(in_width), columns = padded(width);
  kernels::AlignedVector<std::uint16_t> packed(static_cast<std::size_t>(depth * columns));
  kernels::pack_mixed(matrix, depth, columns, packed.data());
  std::vector<float> start(static_cast<std::size_t>(columns), 0.0F);
  if (bias != nullptr) std::copy_n(bias, width, start.begin());
  const Tensor out = torch::empty({rows, width}, x.options());
  const float* in = x.data_ptr<float>();
  float* to = out.data_ptr<float>();
  at::parallel_for(0, (rows + kMixedRows - 1) / kMixedRows, 1, [&](std::int64_t begin, std::int64_t end) {
    kernels::AlignedVector<std::uint16_t> rounded(static_cast<std::size_t>(kMixedRows * depth), 0);
    kernels::AlignedVector<float> wide(static_cast<std::size_t>(columns == width ? 0 : kMixedRows * columns));
    for (std::int64_t first = begin * kMixedRows; first < std::min(rows, end * kMixedRows); first += kMixedRows) {
      const std::int64_t count = std::min(kMixedRows, rows - first);
      float* const sums = columns == width ? to + first * width : wide.data();
      if (depth == in_width && stride == in_width) {
        kernels::round_to_bf16(in + first * depth, count * depth, rounded.data());
      } else {
        for (std::int64_t r = 0; r < count; ++r)
          kernels::round_to_bf16(in + (first + r) * stride, in_width, rounded.data() + r * depth);
      }
      for (std::int64_t r = 0; r < count; ++r) std::copy_n(start.data(), columns, sums + r * columns);
      kernels::multiply_mixed(rounded.data(), packed.data(), count, depth, columns, sums);
      if (columns == width) continue;
      for (std::int64_t r = 0; r < count; ++r) std::copy_n(sums + r * columns, width, to + (first + r) * width);
    }
  });
  return out;
}

// dyᵀ x, the rows of the result shared among the threads, each summed over all rows in their order.
// @param dy [M, N] with adjacent columns @param x [M, K], contiguous @return [N, K]
Tensor mixed_correlation(const Tensor& dy, const Tensor& x) {
  const std::int64_t rows = x.size(0), out = dy.size(1), in = x.size(1), stride = padded(in);
  const Tensor sums = torch::zeros({out, stride}, x.options());
  const float *slopes = dy.data_ptr<float>(), *values = x.data_ptr<float>();
  float* to = sums.data_ptr<float>();
  constexpr std::int64_t kShare = 16;
  at::parallel_for(0, (out + kShare - 1) / kShare, 1, [&](std::int64_t begin, std::int64_t end) {
    const std::int64_t first = begin * kShare, count = std::min(out, end * kShare) - first;
    kernels::correlate_mixed({slopes + first, dy.stride(0), nullptr}, {values, in, nullptr}, rows, count, in,
                             to + first * stride, stride);
  });
  return stride == in ? sums : sums.narrow(1, 0, in);
}

// Of one product of rows [N, in] with a weight [out, in].
double product_operations(const Tensor& rows, const Tensor& weight) {
  return 2.0 * static_cast<double>(rows.size(0)) * static_cast<double>(weight.numel());
}

// x wᵀ + b of fp32 tensors, factors rounded beforehand.
class EmulatedLinear : public torch::autograd::Function<EmulatedLinear> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& x, const Tensor& weight, const Tensor& bias) {
    const Tensor rows = rounded_factor(x).reshape({-1, weight.size(1)}), w = rounded_factor(weight);
    context->save_for_backward({rows, w});
    context->saved_data["shape"] = x.sizes().vec();
    std::vector<std::int64_t> shape = x.sizes().vec();
    shape.back() = weight.size(0);
    return torch::addmm(bias, rows, w.t()).view(shape);
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = saved_once(*context, "a linear layer");
    const Tensor &rows = saved[0], &w = saved[1];
    const Tensor slopes = gradients[0].reshape({-1, w.size(0)}), dy = rounded_factor(slopes);
    Tensor dx, dw, db;
    if (context->needs_input_grad(0)) dx = torch::mm(dy, w).view(context->saved_data["shape"].toIntVector());
    if (context->needs_input_grad(1)) dw = torch::mm(dy.t(), rows);
    if (context->needs_input_grad(2)) db = sum_of_rows(slopes);
    return {dx, dw, db};
  }
};

// x wᵀ + b of fp32 tensors, factors rounded to bf16 by the kernels.
class MixedLinear : public torch::autograd::Function<MixedLinear> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& x, const Tensor& weight, const Tensor& bias) {
    RECORD_USER_SCOPE("matrix products: mixed");
    const Tensor rows = x.reshape({-1, weight.size(1)}).contiguous(), w = padded(weight), start = bias.contiguous();
    context->save_for_backward({rows, w});
    context->saved_data["shape"] = x.sizes().vec();
    count_operations(product_operations(rows, weight), /*mixed=*/true);
    std::vector<std::int64_t> shape = x.sizes().vec();
    shape.back() = weight.size(0);
    return mixed_product(rows, {w.data_ptr<float>(), 1, w.size(1)}, shape.back(), start.data_ptr<float>()).view(shape);
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("matrix products: mixed");
    const variable_list saved = saved_once(*context, "a linear layer");
    const Tensor &rows = saved[0], &w = saved[1];
    const Tensor given = gradients[0].reshape({-1, gradients[0].size(-1)});
    const Tensor dy = given.stride(1) == 1 ? given : given.contiguous();  // often columns of a wider tensor
    Tensor dx, dw, db;
    const int products = (context->needs_input_grad(0) ? 1 : 0) + (context->needs_input_grad(1) ? 1 : 0);
    count_operations(products * product_operations(rows, w), /*mixed=*/true);
    if (context->needs_input_grad(0)) {
      dx = mixed_product(dy, {w.data_ptr<float>(), w.size(1), 1}, rows.size(1), nullptr);
      dx = dx.view(context->saved_data["shape"].toIntVector());
    }
    if (context->needs_input_grad(1)) dw = mixed_correlation(dy, rows);
    if (context->needs_input_grad(2)) db = sum_of_rows(dy);
    return {dx, dw, db};
  }
};

constexpr std::int64_t kGrain = 16384;  // fewer values than this cost less than starting a second thread

class VectorGelu : public torch::autograd::Function<VectorGelu> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& x) {
    RECORD_USER_SCOPE("elementwise and copies: gelu");
    context->save_for_backward({x});
    Tensor y = torch::empty_like(x);
    const float* in = x.data_ptr<float>();
    float* out = y.data_ptr<float>();
    at::parallel_for(0, x.numel(), kGrain, [&](std::int64_t begin, std::int64_t end) {
      kernels::gelu_forward(in + begin, out + begin, end - begin);
    });
    return y;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("elementwise and copies: gelu");
    const Tensor x = context->get_saved_variables()[0];
    const Tensor dy = gradients[0].contiguous();
    Tensor dx = torch::empty_like(x);
    const float *in = x.data_ptr<float>(), *grad = dy.data_ptr<float>();
    float* out = dx.data_ptr<float>();
    at::parallel_for(0, x.numel(), kGrain, [&](std::int64_t begin, std::int64_t end) {
      kernels::gelu_backward(in + begin, grad + begin, out + begin, end - begin);
    });
    return {dx};
  }
};

// Without a gradient.
Tensor bf16_gelu(const Tensor& x) {
  RECORD_USER_SCOPE("elementwise and copies: gelu");
  const Tensor y = torch::empty_like(x);
  const std::uint16_t* in = bf16_bits(x);
  std::uint16_t* out = bf16_bits(y);
  at::parallel_for(0, x.numel(), kGrain, [&](std::int64_t begin, std::int64_t end) {
    kernels::gelu_forward_bf16(in + begin, out + begin, end - begin);
  });
  return y;
}

constexpr std::int64_t kCachedValues = 32768;  // hidden values in flight per thread: two buffers of 128 KiB
constexpr std::int64_t kWidestHidden = 1024;   // beyond it the products dominate and large ones run faster
constexpr std::int64_t kFewestBlocks = 8;      // below it the separate layers are as fast

std::int64_t block_rows(std::int64_t hidden) { return std::max<std::int64_t>(32, kCachedValues / hidden); }

// Calls body(thread's part, first row, last row) for blocks of rows; each part is one contiguous run of blocks, so sums
// over a part do not depend on timing.
template <typename Body>
void for_each_block(std::int64_t rows, std::int64_t block, std::int64_t parts, const Body& body) {
  const std::int64_t blocks = (rows + block - 1) / block;
  at::parallel_for(0, parts, 1, [&](std::int64_t first_part, std::int64_t last_part) {
    const torch::NoGradGuard no_grad;
    for (std::int64_t part = first_part; part < last_part; ++part) {
      for (std::int64_t b = blocks * part / parts; b < blocks * (part + 1) / parts; ++b)
        body(part, b * block, std::min(rows, (b + 1) * block));
    }
  });
}

std::vector<Tensor> one_per_part(std::int64_t parts, torch::IntArrayRef shape) {
  std::vector<Tensor> tensors;
  for (std::int64_t i = 0; i < parts; ++i) tensors.push_back(torch::zeros(shape));
  return tensors;
}

Tensor sum_of(const std::vector<Tensor>& parts) {
  Tensor sum = parts[0];
  for (std::size_t i = 1; i < parts.size(); ++i) sum.add_(parts[i]);
  return sum;
}

class FusedMlp : public torch::autograd::Function<FusedMlp> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& x, const Tensor& w1, const Tensor& b1, const Tensor& w2,
                        const Tensor& b2) {
    context->save_for_backward({x, w1, b1, w2});
    const std::int64_t rows = x.size(0), hidden = w1.size(0), block = block_rows(hidden);
    const std::int64_t parts = at::get_num_threads();
    Tensor y = torch::empty({rows, w2.size(0)});
    std::vector<Tensor> buffers = one_per_part(parts, {block, hidden});
    const Tensor w1_t = w1.t(), w2_t = w2.t();
    const float* bias = b1.data_ptr<float>();
    for_each_block(rows, block, parts, [&](std::int64_t part, std::int64_t first, std::int64_t last) {
      Tensor h = buffers[static_cast<std::size_t>(part)].narrow(0, 0, last - first);
      at::mm_out(h, x.narrow(0, first, last - first), w1_t);
      kernels::gelu_bias(h.data_ptr<float>(), bias, last - first, hidden);
      Tensor out = y.narrow(0, first, last - first);
      at::addmm_out(out, b2, h, w2_t);
    });
    return y;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    const Tensor &x = saved[0], &w1 = saved[1], &b1 = saved[2], &w2 = saved[3];
    const Tensor dy = gradients[0].contiguous();
    const std::int64_t rows = x.size(0), hidden = w1.size(0), block = block_rows(hidden);
    const std::int64_t parts = at::get_num_threads();
    std::vector<Tensor> buffers = one_per_part(parts, {block, hidden}), slopes = one_per_part(parts, {block, hidden});
    std::vector<Tensor> dw1 = one_per_part(parts, w1.sizes()), db1 = one_per_part(parts, b1.sizes());
    std::vector<Tensor> dw2 = one_per_part(parts, w2.sizes()), db2 = one_per_part(parts, {w2.size(0)});
    Tensor dx = context->needs_input_grad(0) ? torch::empty_like(x) : Tensor();
    const Tensor w1_t = w1.t();
    const float* bias = b1.data_ptr<float>();
    for_each_block(rows, block, parts, [&](std::int64_t part, std::int64_t first, std::int64_t last) {
      const auto p = static_cast<std::size_t>(part);
      const std::int64_t count = last - first;
      const Tensor x_rows = x.narrow(0, first, count), dy_rows = dy.narrow(0, first, count);
      Tensor h = buffers[p].narrow(0, 0, count), dh = slopes[p].narrow(0, 0, count);
      at::mm_out(h, x_rows, w1_t);
      at::mm_out(dh, dy_rows, w2);
      kernels::gelu_bias_backward(h.data_ptr<float>(), bias, dh.data_ptr<float>(), count, hidden);
      dw2[p].addmm_(dy_rows.t(), h);
      db2[p].add_(dy_rows.sum(0));
      dw1[p].addmm_(dh.t(), x_rows);
      db1[p].add_(dh.sum(0));
      if (!dx.defined()) return;
      Tensor dx_rows = dx.narrow(0, first, count);
      at::mm_out(dx_rows, dh, w1);
    });
    return {dx, sum_of(dw1), sum_of(db1), sum_of(dw2), sum_of(db2)};
  }
};

}  // namespace

bool prefers_widened_linear(const Tensor& x, const Tensor& weight) {
  return x.is_cpu() && x.scalar_type() == torch::kBFloat16 && weight.scalar_type() == torch::kBFloat16 &&
         !has_bf16_linear();
}

Tensor widened_linear(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  const Tensor y = WideProduct::apply(x, weight);
  return (bias.defined() ? y + bias.to(torch::kFloat32) : y).to(x.scalar_type());
}

Tensor rounded_factor(const Tensor& x) {
  const torch::NoGradGuard no_grad;
  Tensor values = x.detach().clone();  // dense in memory, whatever x was
  kernels::round_in_place(values.data_ptr<float>(), values.numel());
  return values;
}

bool prefers_mixed_linear(const Tensor& x, const Tensor& weight) {
  const std::int64_t in = weight.size(1), out = weight.size(0);
  return mixed_products() && x.is_cpu() && dtype_of(x) == torch::kFloat32 && dtype_of(weight) == torch::kFloat32 &&
         in >= kFewestMixedWidth && out >= kFewestMixedWidth && x.numel() >= kFewestMixedRows * in;
}

Tensor mixed_linear(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  const Tensor start = bias.defined() ? bias : torch::zeros({weight.size(0)}, weight.options());
  return emulated_mixed_products() ? EmulatedLinear::apply(x, weight, start) : MixedLinear::apply(x, weight, start);
}

Tensor linear(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  if (prefers_mixed_linear(x, weight)) return mixed_linear(x, weight, bias);
  return prefers_widened_linear(x, weight) ? widened_linear(x, weight, bias) : torch::linear(x, weight, bias);
}

Tensor gelu_tanh(const Tensor& x) {
  const bool has_gradient = x.requires_grad() && torch::GradMode::is_enabled();
  if (x.is_cpu() && dtype_of(x) == torch::kBFloat16 && !has_gradient) return bf16_gelu(x.detach().contiguous());
  if (!x.is_cpu() || dtype_of(x) != torch::kFloat32) return torch::gelu(x, "tanh");
  return VectorGelu::apply(x.contiguous());
}

bool prefers_fused_mlp(const Tensor& x, const Tensor& w1) {
  const std::int64_t hidden = w1.size(0);
  return !prefers_mixed_linear(x, w1) && x.is_cpu() && x.dim() == 2 && dtype_of(x) == torch::kFloat32 &&
         dtype_of(w1) == torch::kFloat32 && hidden <= kWidestHidden && x.size(0) >= kFewestBlocks * block_rows(hidden);
}

Tensor fused_mlp(const Tensor& x, const Tensor& w1, const Tensor& b1, const Tensor& w2, const Tensor& b2) {
  return FusedMlp::apply(x.contiguous(), w1, b1, w2, b2);
}

}  // namespace anigen::nn
