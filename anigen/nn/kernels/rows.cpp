#include "anigen/nn/kernels/rows.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "anigen/nn/init.h"
#include "anigen/nn/kernels/activations.h"
#include "anigen/nn/norms.h"

namespace anigen::nn::kernels {

namespace {

template <typename Width>
ANIGEN_INLINE float row_sum(const float* row, std::int64_t n) {
  typename Width::Lanes lanes{};
  std::int64_t c = 0;
  for (; c + Width::kLanes <= n; c += Width::kLanes) lanes += lanes_at<Width>(row + c);
  float sum = total(lanes);
  for (; c < n; ++c) sum += row[c];
  return sum;
}

struct Moments {
  float mean, variance;
};

// Both around a first mean, whose rounding would otherwise be most of what is left of a row of nearly equal numbers
// far from 0.
template <typename Width>
ANIGEN_INLINE Moments row_moments(const float* row, std::int64_t n) {
  const float members = static_cast<float>(n), start = row_sum<Width>(row, n) / members;
  typename Width::Lanes lanes{}, squares{};
  std::int64_t c = 0;
  for (; c + Width::kLanes <= n; c += Width::kLanes) {
    const typename Width::Lanes beyond = lanes_at<Width>(row + c) - start;
    lanes += beyond;
    squares += beyond * beyond;
  }
  float sum = total(lanes), squares_sum = total(squares);
  for (; c < n; ++c) {
    sum += row[c] - start;
    squares_sum += (row[c] - start) * (row[c] - start);
  }
  const float rest = sum / members, variance = squares_sum / members - rest * rest;
  return {start + rest, variance < 0.0F ? 0.0F : variance};  // NaN stays NaN
}

// y = (x − mean) rstd (base + factor) + shift
template <typename Width>
ANIGEN_INLINE void scale_row(const RowNorm& norm, const float* row, const float* factor, const float* shift, float mean,
                             float rstd, float* out) {
  std::int64_t c = 0;
  for (; c + Width::kLanes <= norm.channels; c += Width::kLanes) {
    lanes_at<Width>(out + c) = (lanes_at<Width>(row + c) - mean) * rstd * (lanes_at<Width>(factor + c) + norm.base) +
                               lanes_at<Width>(shift + c);
  }
  for (; c < norm.channels; ++c) out[c] = (row[c] - mean) * rstd * (norm.base + factor[c]) + shift[c];
}

template <typename Width, typename T>
ANIGEN_INLINE void norm_by(const RowNorm& norm, const T* x, const float* factor, const float* shift, T* y, float* means,
                           float* rstds, const RowScratch& scratch) {
  const std::int64_t n = norm.channels;
  for (std::int64_t r = 0; r < norm.rows; ++r, x += n, y += n) {
    const float* const row = widened(x, n, scratch.x);
    const Moments moments = row_moments<Width>(row, n);
    const float rstd = 1.0F / std::sqrt(moments.variance + norm.eps);
    float* const out = wide_row(y, scratch.dy);
    scale_row<Width>(norm, row, factor, shift, moments.mean, rstd, out);
    round_row(out, n, y);
    means[r] = moments.mean;
    rstds[r] = rstd;
  }
}

template <typename T>
ANIGEN_INLINE void norm(const RowNorm& norm, const T* x, const float* factor, const float* shift, T* y, float* means,
                        float* rstds, const RowScratch& scratch) {
  if (fills_wide(norm.channels)) {
    norm_by<Wide>(norm, x, factor, shift, y, means, rstds, scratch);
  } else {
    norm_by<Narrow>(norm, x, factor, shift, y, means, rstds, scratch);
  }
}

// With g = dy (base + factor): dx = (g − (Σ g + x̂ Σ g x̂) / C) / σ, d_factor = Σ dy x̂, d_shift = Σ dy.
template <typename Width, typename T>
ANIGEN_INLINE void norm_backward_by(const RowNorm& norm, const T* x, const T* dy, const float* factor,
                                    const float* means, const float* rstds, T* dx, float* d_factor, float* d_shift,
                                    const RowScratch& scratch) {
  using Lanes = typename Width::Lanes;
  const std::int64_t n = norm.channels;
  const auto members = static_cast<float>(n);
  for (std::int64_t r = 0; r < norm.rows; ++r, x += n, dy += n, dx += n) {
    const float *const row = widened(x, n, scratch.x), *const slope = widened(dy, n, scratch.dy);
    const float mean = means[r], rstd = rstds[r];
    Lanes sums{}, with_unit{};
    std::int64_t c = 0;
    for (; c + Width::kLanes <= n; c += Width::kLanes) {
      const Lanes d = lanes_at<Width>(slope + c), unit = (lanes_at<Width>(row + c) - mean) * rstd;
      const Lanes g = d * (lanes_at<Width>(factor + c) + norm.base);
      sums += g;
      with_unit += g * unit;
      lanes_at<Width>(d_factor + c) += d * unit;
      lanes_at<Width>(d_shift + c) += d;
    }
    float sum = total(sums), unit_sum = total(with_unit);
    for (; c < n; ++c) {
      const float unit = (row[c] - mean) * rstd, g = slope[c] * (norm.base + factor[c]);
      sum += g;
      unit_sum += g * unit;
      d_factor[c] += slope[c] * unit;
      d_shift[c] += slope[c];
    }
    const float constant = sum / members, of_unit = unit_sum / members;
    float* const out = wide_row(dx, scratch.x);
    for (c = 0; c + Width::kLanes <= n; c += Width::kLanes) {
      const Lanes unit = (lanes_at<Width>(row + c) - mean) * rstd;
      const Lanes g = lanes_at<Width>(slope + c) * (lanes_at<Width>(factor + c) + norm.base);
      lanes_at<Width>(out + c) = rstd * (g - constant - unit * of_unit);
    }
    for (; c < n; ++c) {
      const float unit = (row[c] - mean) * rstd;
      out[c] = rstd * (slope[c] * (norm.base + factor[c]) - constant - unit * of_unit);
    }
    round_row(out, n, dx);
  }
}

template <typename T>
ANIGEN_INLINE void norm_backward(const RowNorm& norm, const T* x, const T* dy, const float* factor, const float* means,
                                 const float* rstds, T* dx, float* d_factor, float* d_shift,
                                 const RowScratch& scratch) {
  if (fills_wide(norm.channels)) {
    norm_backward_by<Wide>(norm, x, dy, factor, means, rstds, dx, d_factor, d_shift, scratch);
  } else {
    norm_backward_by<Narrow>(norm, x, dy, factor, means, rstds, dx, d_factor, d_shift, scratch);
  }
}

ANIGEN_INLINE float as_float(float x) { return x; }
ANIGEN_INLINE float as_float(std::uint16_t x) { return bits_as<float>(static_cast<std::uint32_t>(x) << 16); }
ANIGEN_INLINE void store(float x, float* to) { *to = x; }
ANIGEN_INLINE void store(float x, std::uint16_t* to) { round_row(&x, 1, to); }

template <typename T>
ANIGEN_INLINE void gated(std::int64_t rows, std::int64_t n, const T* __restrict x, const float* __restrict gate,
                         const T* __restrict result, T* __restrict y) {
  for (std::int64_t r = 0; r < rows; ++r, x += n, result += n, y += n) {
    for (std::int64_t c = 0; c < n; ++c) store(as_float(x[c]) + gate[c] * as_float(result[c]), y + c);
  }
}

template <typename T>
ANIGEN_INLINE void gated_backward(std::int64_t rows, std::int64_t n, const T* __restrict dy,
                                  const float* __restrict gate, const T* __restrict result, T* __restrict d_result,
                                  float* __restrict d_gate) {
  for (std::int64_t r = 0; r < rows; ++r, dy += n, result += n, d_result += n) {
    for (std::int64_t c = 0; c < n; ++c) {
      store(as_float(dy[c]) * gate[c], d_result + c);
      d_gate[c] += as_float(dy[c]) * as_float(result[c]);
    }
  }
}

// y = x + gate · result @param gate [C] of all rows
ANIGEN_KERNEL(void, add_gated_rows,
              (std::int64_t rows, std::int64_t channels, const float* x, const float* gate, const float* result,
               float* y),
              (rows, channels, x, gate, result, y)) {
  gated(rows, channels, x, gate, result, y);
}

ANIGEN_KERNEL(void, add_gated_rows,
              (std::int64_t rows, std::int64_t channels, const std::uint16_t* x, const float* gate,
               const std::uint16_t* result, std::uint16_t* y),
              (rows, channels, x, gate, result, y)) {
  gated(rows, channels, x, gate, result, y);
}

// d_result = gate · dy; adds Σ dy · result to d_gate, [C].
ANIGEN_KERNEL(void, add_gated_rows_backward,
              (std::int64_t rows, std::int64_t channels, const float* dy, const float* gate, const float* result,
               float* d_result, float* d_gate),
              (rows, channels, dy, gate, result, d_result, d_gate)) {
  gated_backward(rows, channels, dy, gate, result, d_result, d_gate);
}

ANIGEN_KERNEL(void, add_gated_rows_backward,
              (std::int64_t rows, std::int64_t channels, const std::uint16_t* dy, const float* gate,
               const std::uint16_t* result, std::uint16_t* d_result, float* d_gate),
              (rows, channels, dy, gate, result, d_result, d_gate)) {
  gated_backward(rows, channels, dy, gate, result, d_result, d_gate);
}

}  // namespace

ANIGEN_KERNEL(void, norm_rows,
              (const RowNorm& shape, const float* x, const float* factor, const float* shift, float* y, float* mean,
               float* rstd, const RowScratch& scratch),
              (shape, x, factor, shift, y, mean, rstd, scratch)) {
  norm(shape, x, factor, shift, y, mean, rstd, scratch);
}

ANIGEN_KERNEL(void, norm_rows,
              (const RowNorm& shape, const std::uint16_t* x, const float* factor, const float* shift, std::uint16_t* y,
               float* mean, float* rstd, const RowScratch& scratch),
              (shape, x, factor, shift, y, mean, rstd, scratch)) {
  norm(shape, x, factor, shift, y, mean, rstd, scratch);
}

ANIGEN_KERNEL(void, scale_rows,
              (const RowNorm& norm, const float* x, const float* factor, const float* shift, const float* mean,
               const float* rstd, float* y),
              (norm, x, factor, shift, mean, rstd, y)) {
  const std::int64_t n = norm.channels;
  for (std::int64_t r = 0; r < norm.rows; ++r) {
    if (fills_wide(n)) {
      scale_row<Wide>(norm, x + r * n, factor, shift, mean[r], rstd[r], y + r * n);
    } else {
      scale_row<Narrow>(norm, x + r * n, factor, shift, mean[r], rstd[r], y + r * n);
    }
  }
}

ANIGEN_KERNEL(void, norm_rows_backward,
              (const RowNorm& shape, const float* x, const float* dy, const float* factor, const float* mean,
               const float* rstd, float* dx, float* d_factor, float* d_shift, const RowScratch& scratch),
              (shape, x, dy, factor, mean, rstd, dx, d_factor, d_shift, scratch)) {
  norm_backward(shape, x, dy, factor, mean, rstd, dx, d_factor, d_shift, scratch);
}

ANIGEN_KERNEL(void, norm_rows_backward,
              (const RowNorm& shape, const std::uint16_t* x, const std::uint16_t* dy, const float* factor,
               const float* mean, const float* rstd, std::uint16_t* dx, float* d_factor, float* d_shift,
               const RowScratch& scratch),
              (shape, x, dy, factor, mean, rstd, dx, d_factor, d_shift, scratch)) {
  norm_backward(shape, x, dy, factor, mean, rstd, dx, d_factor, d_shift, scratch);
}

}  // namespace anigen::nn::kernels

namespace anigen::nn {

namespace {

bool has_kernels(const Tensor& x) {
  return x.is_cpu() && (dtype_of(x) == torch::kFloat32 || dtype_of(x) == torch::kBFloat16);
}

// body(pointer(tensor)...) with pointers of the kernels' type for a dtype that has kernels.
template <typename Body>
void with_pointers(const Tensor& x, const Body& body) {
  if (dtype_of(x) == torch::kBFloat16) {
    body([](const Tensor& t) { return bf16_bits(t); });
  } else {
    body([](const Tensor& t) { return t.data_ptr<float>(); });
  }
}

Tensor as_rows_of_fp32(const Tensor& x) {
  TORCH_CHECK(x.is_cpu(), "rows on the CPU beside values on ", x.device());
  return x.to(torch::kFloat32).contiguous();
}

class NormRowsFunction : public torch::autograd::Function<NormRowsFunction> {
 public:
  // LN(x) (base + factor) + shift. @param x [N, C], contiguous @param factor, shift [B, C]
  static Tensor forward(AutogradContext* context, const Tensor& x, const Tensor& factor, const Tensor& shift,
                        const std::vector<std::int64_t>& lengths, double base, double eps) {
    RECORD_USER_SCOPE("elementwise and copies: norm, modulation");
    const std::int64_t channels = x.size(1);
    const std::vector<RowBlock> blocks = row_blocks(lengths, channels);
    const Tensor factors = as_rows_of_fp32(factor), shifts = as_rows_of_fp32(shift), y = torch::empty_like(x);
    const Tensor statistics = torch::empty({2, x.size(0)}, torch::kFloat32);
    float *const means = statistics.data_ptr<float>(), *const rstds = means + x.size(0);
    const float *const of_items = factors.data_ptr<float>(), *const added = shifts.data_ptr<float>();
    with_pointers(x, [&](const auto& pointer) {
      auto *const in = pointer(x), *const out = pointer(y);
      for_each_block(blocks, [&](const RowBlock& block, std::int64_t) {
        std::vector<float> scratch(static_cast<std::size_t>(2 * channels));
        kernels::norm_rows({block.count, channels, static_cast<float>(base), static_cast<float>(eps)},
                           in + block.first * channels, of_items + block.item * channels, added + block.item * channels,
                           out + block.first * channels, means + block.first, rstds + block.first,
                           {scratch.data(), scratch.data() + channels});
      });
    });
    context->save_for_backward({x, factor, statistics});
    context->saved_data["lengths"] = lengths;
    context->saved_data["base"] = base;
    context->saved_data["shift"] = static_cast<std::int64_t>(shift.scalar_type());
    return y;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("elementwise and copies: norm, modulation");
    const variable_list saved = saved_once(*context, "modulated layer norm");
    const Tensor &x = saved[0], &statistics = saved[2], dy = gradients[0].contiguous();
    const std::vector<std::int64_t> lengths = context->saved_data["lengths"].toIntVector();
    const auto base = static_cast<float>(context->saved_data["base"].toDouble());
    const std::int64_t channels = x.size(1);
    const std::vector<RowBlock> blocks = row_blocks(lengths, channels);
    const auto parts = static_cast<std::int64_t>(blocks.size());
    const Tensor factors = as_rows_of_fp32(saved[1]), dx = torch::empty_like(x);
    const Tensor sums = torch::zeros({2, parts, channels}, torch::kFloat32);
    const float *const means = statistics.data_ptr<float>(), *const rstds = means + x.size(0);
    const float* const of_items = factors.data_ptr<float>();
    float *const d_factors = sums.data_ptr<float>(), *const d_shifts = d_factors + parts * channels;
    with_pointers(x, [&](const auto& pointer) {
      auto *const in = pointer(x), *const slopes = pointer(dy), *const out = pointer(dx);
      for_each_block(blocks, [&](const RowBlock& block, std::int64_t b) {
        std::vector<float> scratch(static_cast<std::size_t>(2 * channels));
        const std::int64_t at = block.first * channels;
        kernels::norm_rows_backward({block.count, channels, base, 0.0F}, in + at, slopes + at,
                                    of_items + block.item * channels, means + block.first, rstds + block.first,
                                    out + at, d_factors + b * channels, d_shifts + b * channels,
                                    {scratch.data(), scratch.data() + channels});
      });
    });
    const auto items = static_cast<std::int64_t>(lengths.size());
    const auto shift_dtype = static_cast<torch::Dtype>(context->saved_data["shift"].toInt());
    return {dx,
            sums_of_items(blocks, sums[0], items).to(dtype_of(saved[1])),
            sums_of_items(blocks, sums[1], items).to(shift_dtype),
            Tensor(),
            Tensor(),
            Tensor()};
  }
};

class AddGatedFunction : public torch::autograd::Function<AddGatedFunction> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& x, const Tensor& gate, const Tensor& result,
                        const std::vector<std::int64_t>& lengths) {
    RECORD_USER_SCOPE("elementwise and copies: norm, modulation");
    const std::int64_t channels = x.size(1);
    const Tensor gates = as_rows_of_fp32(gate), y = torch::empty_like(x);
    const float* const of_items = gates.data_ptr<float>();
    with_pointers(x, [&](const auto& pointer) {
      auto *const in = pointer(x), *const added = pointer(result), *const out = pointer(y);
      for_each_block(row_blocks(lengths, channels), [&](const RowBlock& block, std::int64_t) {
        const std::int64_t at = block.first * channels;
        kernels::add_gated_rows(block.count, channels, in + at, of_items + block.item * channels, added + at, out + at);
      });
    });
    context->save_for_backward({gate, result});
    context->saved_data["lengths"] = lengths;
    return y;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("elementwise and copies: norm, modulation");
    const variable_list saved = saved_once(*context, "a gated sum");
    const Tensor &result = saved[1], dy = gradients[0].contiguous();
    const std::vector<std::int64_t> lengths = context->saved_data["lengths"].toIntVector();
    const std::int64_t channels = result.size(1);
    const std::vector<RowBlock> blocks = row_blocks(lengths, channels);
    const Tensor gates = as_rows_of_fp32(saved[0]), d_result = torch::empty_like(result);
    const Tensor sums = torch::zeros({static_cast<std::int64_t>(blocks.size()), channels}, torch::kFloat32);
    const float* const of_items = gates.data_ptr<float>();
    float* const d_gates = sums.data_ptr<float>();
    with_pointers(result, [&](const auto& pointer) {
      auto *const slopes = pointer(dy), *const values = pointer(result), *const out = pointer(d_result);
      for_each_block(blocks, [&](const RowBlock& block, std::int64_t b) {
        const std::int64_t at = block.first * channels;
        kernels::add_gated_rows_backward(block.count, channels, slopes + at, of_items + block.item * channels,
                                         values + at, out + at, d_gates + b * channels);
      });
    });
    const Tensor d_gate = sums_of_items(blocks, sums, static_cast<std::int64_t>(lengths.size()));
    return {gradients[0], d_gate.to(dtype_of(saved[0])), d_result, Tensor()};
  }
};

void check_rows(const char* what, const Tensor& x, const Ragged& items, const Tensor& values) {
  TORCH_CHECK(x.dim() == 2 && x.size(0) == items.rows() && values.dim() == 2 && values.size(0) == items.items() &&
                  values.size(1) == x.size(1),
              what, " of ", items.items(), " items with ", items.rows(), " rows: rows ", shape_text(x), ", values ",
              shape_text(values));
}

// Values of each item at all of its rows, [B, C] → [N, C]. The gradient is a product with the rows of each item marked
// by ones: a GPU that added rows up one by one would have thousands of them wait for the same few sums.
class SpreadOverRows : public torch::autograd::Function<SpreadOverRows> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& values, const Tensor& item) {
    context->save_for_backward({item});
    context->saved_data["items"] = values.size(0);
    return values.index_select(0, item);
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const Tensor item = saved_once(*context, "values spread over rows")[0], &slopes = gradients[0];
    const Tensor items = torch::arange(context->saved_data["items"].toInt(), item.options()).unsqueeze(1);
    return {torch::mm(items.eq(item.unsqueeze(0)).to(slopes.scalar_type()), slopes), Tensor()};
  }
};

Tensor spread(const Tensor& values, const Ragged& items) {
  return SpreadOverRows::apply(values, items.item_of_rows(values.device()));
}

// Rows of the first item when all have as many, as those of a dense batch have; otherwise 0.
std::int64_t common_length(const Ragged& items) {
  const std::vector<std::int64_t>& lengths = items.lengths();
  const bool same = std::all_of(lengths.begin(), lengths.end(), [&](std::int64_t n) { return n == lengths[0]; });
  return lengths.empty() || !same ? 0 : lengths[0];
}

Tensor as_batch(const Tensor& rows, std::int64_t length) { return rows.reshape({-1, length, rows.size(1)}); }

}  // namespace

Tensor modulated_norm(const Tensor& x, const Ragged& items, const Tensor& shift, const Tensor& scale, double eps) {
  check_rows("modulated layer norm", x, items, shift);
  check_rows("modulated layer norm", x, items, scale);
  if (has_kernels(x)) return NormRowsFunction::apply(x.contiguous(), scale, shift, items.lengths(), 1.0, eps);
  const Tensor normed = layer_norm(x, eps), factor = scale + 1.0;
  if (items.rows() == 0) return normed;
  if (const std::int64_t length = common_length(items); length > 0)
    return torch::addcmul(shift.unsqueeze(1), as_batch(normed, length), factor.unsqueeze(1)).view(x.sizes());
  return torch::addcmul(spread(shift, items), normed, spread(factor, items));
}

Tensor affine_norm(const Tensor& x, const Tensor& weight, const Tensor& bias, double eps) {
  TORCH_CHECK(x.dim() >= 1 && weight.dim() == 1 && bias.dim() == 1 && weight.size(0) == x.size(-1) &&
                  bias.size(0) == x.size(-1),
              "layer norm with weight ", shape_text(weight), " and bias ", shape_text(bias), ": rows ", shape_text(x));
  if (has_kernels(x) && x.size(-1) > 0) {
    const Tensor rows = x.reshape({-1, x.size(-1)}).contiguous();
    return NormRowsFunction::apply(rows, weight.unsqueeze(0), bias.unsqueeze(0),
                                   std::vector<std::int64_t>{rows.size(0)}, 0.0, eps)
        .view(x.sizes());
  }
  const torch::Dtype wide = accumulation_dtype(dtype_of(x));
  return torch::layer_norm(x.to(wide), {x.size(-1)}, weight.to(wide), bias.to(wide), eps).to(dtype_of(x));
}

Tensor add_gated(const Tensor& x, const Ragged& items, const Tensor& gate, const Tensor& result) {
  check_rows("a gated sum", x, items, gate);
  TORCH_CHECK(result.sizes() == x.sizes() && result.scalar_type() == x.scalar_type() && result.device() == x.device(),
              "a gated sum of ", shape_text(x), " ", x.options(), " and ", shape_text(result), " ", result.options());
  if (has_kernels(x)) return AddGatedFunction::apply(x.contiguous(), gate, result.contiguous(), items.lengths());
  if (items.rows() == 0) return x;
  if (const std::int64_t length = common_length(items); length > 0)
    return torch::addcmul(as_batch(x, length), as_batch(result, length), gate.unsqueeze(1)).view(x.sizes());
  return torch::addcmul(x, result, spread(gate, items));
}

}  // namespace anigen::nn
