#include <ATen/Parallel.h>

#include <algorithm>

#include "anigen/nn/bf16_bits.h"
#include "anigen/nn/bf16_tile.h"
#include "anigen/sparse/convolution_bf16_kernels.h"
#include "anigen/sparse/convolution_kernels.h"
#include "anigen/sparse/tap_product.h"

namespace anigen::sparse {
namespace {

using kernels::kPanel;

// Rows that are worked on before the next ones, tap after tap: few enough that what a block reads and writes stays in a
// second-level cache, enough for the matrices that pass by meanwhile to pay, and enough blocks for many threads.
// Independent of their number, so that the bits of the result are.
constexpr std::int64_t kFewestRows = 128, kCachedValues = 65536, kWantedBlocks = 32;

class RowBlocks {
 public:
  RowBlocks(const TapPlan& plan, std::int64_t rows, std::int64_t in_channels, std::int64_t out_channels) : rows_(rows) {
    const std::int64_t values = plan.from_children * in_channels + plan.to_children * out_channels;
    const std::int64_t most = std::max(kFewestRows, kCachedValues / std::max<std::int64_t>(1, values));
    length_ = std::clamp(rows / kWantedBlocks, kFewestRows, most);
  }
  std::int64_t count() const { return (rows_ + length_ - 1) / length_; }
  std::int64_t length() const { return length_; }
  std::int64_t begin(std::int64_t block) const { return block * length_; }
  std::int64_t end(std::int64_t block) const { return std::min(rows_, (block + 1) * length_); }

 private:
  std::int64_t rows_, length_;
};

// The pairs of rows that a link joins within a block; one list at a time.
class PairList {
 public:
  PairList(const TapPlan& plan, const Tensor& neighbours, std::int64_t most)
      : plan_(plan),
        neighbours_(neighbours.data_ptr<std::int32_t>()),
        rows_(neighbours.size(1)),
        from_(static_cast<std::size_t>(most)),
        to_(static_cast<std::size_t>(most)) {}

  kernels::RowPairs list(const TapLink& link, std::int64_t begin, std::int64_t end) {
    const std::int32_t* const found = neighbours_ + link.tap * rows_;
    std::size_t count = 0;
    for (std::int64_t row = begin; row < end; ++row) {  // writes every pair, and steps on where there is one
      from_[count] = static_cast<std::int32_t>(found[row] * plan_.from_children + link.from_child);
      to_[count] = static_cast<std::int32_t>(row * plan_.to_children + link.to_child);
      count += found[row] >= 0 ? 1 : 0;
    }
    return {from_.data(), to_.data(), static_cast<std::int64_t>(count)};
  }

 private:
  const TapPlan& plan_;
  const std::int32_t* neighbours_;
  std::int64_t rows_;
  std::vector<std::int32_t> from_, to_;
};

std::int64_t panels_of(std::int64_t channels) { return (channels + kPanel - 1) / kPanel; }

// [M, Cin, Cout] → [M, panels, Cin, kPanel]
Tensor in_panels(const Tensor& matrices) {
  const std::int64_t in_channels = matrices.size(1), panels = panels_of(matrices.size(2));
  const std::int64_t missing = panels * kPanel - matrices.size(2);
  const Tensor filled = missing > 0 ? at::constant_pad_nd(matrices, {0, missing}) : matrices;
  return filled.reshape({matrices.size(0), in_channels, panels, kPanel}).permute({0, 2, 1, 3}).contiguous();
}

// Calls multiply(pairs, link) for all rows, link after link.
template <typename Multiply>
void for_each_link(const TapPlan& plan, const Tensor& neighbours, std::int64_t in_channels, std::int64_t out_channels,
                   const Multiply& multiply) {
  const RowBlocks blocks(plan, neighbours.size(1), in_channels, out_channels);
  at::parallel_for(0, blocks.count(), 1, [&](std::int64_t first, std::int64_t last) {
    PairList pairs(plan, neighbours, blocks.length());
    for (std::int64_t block = first; block < last; ++block) {
      for (const TapLink& link : plan.links) {
        multiply(pairs.list(link, blocks.begin(block), blocks.end(block)), link);
      }
    }
  });
}

template <typename T>
void add_products(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& panels, Tensor& out) {
  const std::int64_t in_channels = in.size(1), out_channels = out.size(1);
  const std::int64_t matrix_values = panels_of(out_channels) * in_channels * kPanel;
  const T *in_data = in.data_ptr<T>(), *panel_data = panels.data_ptr<T>();
  T* const out_data = out.data_ptr<T>();
  for_each_link(plan, neighbours, in_channels, out_channels, [&](const kernels::RowPairs& pairs, const TapLink& link) {
    kernels::multiply_pairs(pairs, in_data, in_channels, panel_data + link.matrix * matrix_values, out_data,
                            out_channels);
  });
}

// Parallel over the halves of the matrices (fewer would leave two threads with unequal shares), each summed over all
// rows in one order.
template <typename T>
void add_correlations(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes,
                      Tensor& matrices) {
  const std::int64_t in_channels = in.size(1), out_channels = slopes.size(1), half = (in_channels + 1) / 2;
  const std::int64_t stride = matrices.size(2);
  const T *in_data = in.data_ptr<T>(), *slope_data = slopes.data_ptr<T>();
  T* const sums = matrices.data_ptr<T>();
  const RowBlocks blocks(plan, neighbours.size(1), in_channels, out_channels);
  at::parallel_for(0, 2 * plan.matrices(), 1, [&](std::int64_t begin, std::int64_t end) {
    PairList pairs(plan, neighbours, blocks.length());
    for (std::int64_t block = 0; block < blocks.count(); ++block) {
      for (std::int64_t i = begin / 2; i < (end + 1) / 2; ++i) {
        const TapLink& link = plan.links[static_cast<std::size_t>(i)];
        const std::int64_t first = 2 * i < begin ? half : 0, last = 2 * i + 1 < end ? in_channels : half;
        kernels::correlate_pairs(pairs.list(link, blocks.begin(block), blocks.end(block)), in_data, in_channels, first,
                                 last - first, slope_data, out_channels,
                                 sums + (link.matrix * in_channels + first) * stride);
      }
    }
  });
}

}  // namespace

void add_cpu_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                         Tensor& out) {
  const Tensor rows = in.contiguous(), panels = in_panels(matrices);
  if (nn::dtype_of(out) == torch::kFloat64) {
    add_products<double>(plan, neighbours, rows, panels, out);
  } else {
    add_products<float>(plan, neighbours, rows, panels, out);
  }
}

bool prefers_bf16_tap_product(const Tensor& in, const Tensor& matrices) {
  return in.is_cpu() && nn::dtype_of(in) == torch::kBFloat16 && nn::kernels::has_bf16_products() &&
         kernels::bf16_pairs_take(matrices.size(1), matrices.size(2));
}

void add_bf16_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                          Tensor& out) {
  const Tensor rows = in.contiguous(), rounded = matrices.to(torch::kBFloat16).contiguous();
  const std::int64_t in_channels = in.size(1), out_channels = out.size(1), matrix_values = in_channels * out_channels;
  const Tensor packed = torch::empty_like(rounded);
  at::parallel_for(0, rounded.size(0), 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t m = begin * matrix_values; m < end * matrix_values; m += matrix_values) {
      kernels::pack_bf16_matrix(nn::bf16_bits(rounded) + m, in_channels, out_channels, nn::bf16_bits(packed) + m);
    }
  });
  const std::uint16_t *in_data = nn::bf16_bits(rows), *packed_data = nn::bf16_bits(packed);
  float* const out_data = out.data_ptr<float>();
  for_each_link(plan, neighbours, in_channels, out_channels, [&](const kernels::RowPairs& pairs, const TapLink& link) {
    kernels::multiply_bf16_pairs(pairs, in_data, in_channels, packed_data + link.matrix * matrix_values, out_data,
                                 out_channels);
  });
}

Tensor cpu_tap_correlation(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes) {
  const Tensor rows = in.contiguous(), slope_rows = slopes.contiguous();
  Tensor matrices = torch::zeros({plan.matrices(), in.size(1), panels_of(slopes.size(1)) * kPanel}, in.options());
  if (nn::dtype_of(in) == torch::kFloat64) {
    add_correlations<double>(plan, neighbours, rows, slope_rows, matrices);
  } else {
    add_correlations<float>(plan, neighbours, rows, slope_rows, matrices);
  }
  return matrices.narrow(2, 0, slopes.size(1));
}

}  // namespace anigen::sparse
