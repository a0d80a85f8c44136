#include "anigen/shape_field/row_links.h"

#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>
#include <algorithm>

namespace anigen::shape_field {

namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr std::int64_t kLinksPerTask = 1 << 12;

void require_table(const Tensor& values) {
  TORCH_CHECK(values.scalar_type() == torch::kFloat32 || values.scalar_type() == torch::kFloat64, "rows of type ",
              values.dtype(), "; expected fp32 or fp64");
}

// Rows whose channels are adjacent in memory; a single channel always is.
Tensor with_adjacent_channels(const Tensor& x) { return x.size(-1) <= 1 || x.stride(-1) == 1 ? x : x.contiguous(); }

template <typename T>
void gather_kernel(const Tensor& table, const Tensor& targets, const Tensor& out) {
  const T* rows = table.data_ptr<T>();
  const std::int64_t* target = targets.data_ptr<std::int64_t>();
  T* values = out.data_ptr<T>();
  const std::int64_t channels = table.size(1), stride = table.stride(0);
  at::parallel_for(0, targets.size(0), kLinksPerTask, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t i = begin; i < end; ++i) {
      if (target[i] < 0) {
        std::fill_n(values + i * channels, channels, T(0));
      } else {
        std::copy_n(rows + target[i] * stride, channels, values + i * channels);
      }
    }
  });
}

template <typename T>
void sum_kernel(const Tensor& list, const Tensor& sources, const Tensor& out) {
  const T* entries = list.data_ptr<T>();
  const std::int32_t* source = sources.data_ptr<std::int32_t>();
  T* sums = out.data_ptr<T>();
  const std::int64_t channels = list.size(2), slots = sources.size(1);
  const std::int64_t outer = list.stride(0), inner = list.stride(1);
  const auto group = static_cast<std::int32_t>(std::max<std::int64_t>(1, list.size(1)));
  const bool even = outer == group * inner;  // most lists: spares a division per entry
  at::parallel_for(0, sources.size(0), kLinksPerTask, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t row = begin; row < end; ++row) {
      T* sum = sums + row * channels;
      std::fill_n(sum, channels, T(0));
      for (std::int64_t slot = 0; slot < slots; ++slot) {
        const std::int32_t entry = source[row * slots + slot];
        if (entry < 0) continue;
        const T* values = entries + (even ? entry * inner : entry / group * outer + entry % group * inner);
        for (std::int64_t c = 0; c < channels; ++c) sum[c] += values[c];
      }
    }
  });
}

// index_select for other devices, with zeros where the index is negative.
Tensor select_or_zero(const Tensor& rows, const Tensor& index) {
  if (rows.size(0) == 0) return torch::zeros({index.size(0), rows.size(1)}, rows.options());
  return rows.index_select(0, index.clamp_min(0)).masked_fill_((index < 0).unsqueeze(1), 0);
}

Tensor gathered(const Tensor& table, const Tensor& targets) {
  if (!table.is_cpu()) return select_or_zero(table, targets);
  const Tensor rows = with_adjacent_channels(table), index = targets.contiguous();
  const Tensor out = torch::empty({index.size(0), rows.size(1)}, rows.options());
  AT_DISPATCH_FLOATING_TYPES(rows.scalar_type(), "gather_rows", [&] { gather_kernel<scalar_t>(rows, index, out); });
  return out;
}

Tensor summed(const Tensor& list, const Tensor& sources) {
  const std::int64_t channels = list.size(-1);
  if (!list.is_cpu()) {
    const Tensor rows = list.reshape({list.dim() == 3 ? list.size(0) * list.size(1) : list.size(0), channels});
    Tensor out = torch::zeros({sources.size(0), channels}, list.options());
    for (std::int64_t slot = 0; slot < sources.size(1); ++slot)
      out = out + select_or_zero(rows, sources.select(1, slot).to(torch::kInt64));
    return out;
  }
  const Tensor entries = with_adjacent_channels(list.dim() == 3 ? list : list.unsqueeze(1));
  const Tensor slots = sources.contiguous();
  const Tensor out = torch::empty({slots.size(0), channels}, list.options());
  AT_DISPATCH_FLOATING_TYPES(list.scalar_type(), "sum_rows", [&] { sum_kernel<scalar_t>(entries, slots, out); });
  return out;
}

class GatherRows : public torch::autograd::Function<GatherRows> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& table, const Tensor& targets, const Tensor& sources) {
    context->save_for_backward({targets, sources});
    return gathered(table, targets);
  }
  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    return {sum_rows(gradients[0], RowLinks{saved[0], saved[1]}), Tensor(), Tensor()};
  }
};

class SumRows : public torch::autograd::Function<SumRows> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& list, const Tensor& targets, const Tensor& sources) {
    context->save_for_backward({targets, sources});
    context->saved_data["shape"] = list.sizes().vec();
    return summed(list, sources);
  }
  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    const Tensor entries = gather_rows(gradients[0], RowLinks{saved[0], saved[1]});
    return {entries.view(context->saved_data["shape"].toIntVector()), Tensor(), Tensor()};
  }
};

}  // namespace

Tensor gather_rows(const Tensor& table, const RowLinks& links) {
  require_table(table);
  TORCH_CHECK(table.dim() == 2 && table.size(0) == links.sources.size(0), "a table ", table.sizes(), " for ",
              links.sources.size(0), " rows");
  return GatherRows::apply(table, links.targets, links.sources);
}

Tensor sum_rows(const Tensor& list, const RowLinks& links) {
  require_table(list);
  TORCH_CHECK((list.dim() == 2 && list.size(0) == links.targets.size(0)) ||
                  (list.dim() == 3 && list.size(0) * list.size(1) == links.targets.size(0)),
              "a list ", list.sizes(), " for ", links.targets.size(0), " entries");
  return SumRows::apply(list, links.targets, links.sources);
}

}  // namespace anigen::shape_field
