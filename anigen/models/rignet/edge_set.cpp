#include "anigen/models/rignet/edge_set.h"

#include <cmath>
#include <limits>
#include <vector>

#include "anigen/models/anymate/checks.h"

namespace anigen::models::rignet {
namespace {

using anymate::require;
using anymate::require_shape;
using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr std::int64_t kLeastTargets = 64, kLeastChannels = 8;  // of a task

// Rows of x [N, C] summed per run. Each run belongs to one task, so the order of summation is fixed.
template <typename T>
void sum_runs(const T* rows, const std::int64_t* offsets, std::int64_t runs, std::int64_t channels, T* sums) {
  at::parallel_for(0, runs, kLeastTargets, [&](std::int64_t first, std::int64_t last) {
    for (std::int64_t i = first; i < last; ++i) {
      T* out = sums + i * channels;
      for (std::int64_t e = offsets[i]; e < offsets[i + 1]; ++e) {
        const T* row = rows + e * channels;
        for (std::int64_t c = 0; c < channels; ++c) out[c] += row[c];
      }
    }
  });
}

// Rows added to the places that index names. Tasks share out channels: any of them may meet any place.
template <typename T>
void add_rows(const T* rows, const std::int64_t* index, std::int64_t count, std::int64_t channels, T* sums) {
  at::parallel_for(0, channels, kLeastChannels, [&](std::int64_t first, std::int64_t last) {
    for (std::int64_t e = 0; e < count; ++e) {
      const T* row = rows + e * channels;
      T* out = sums + index[e] * channels;
      for (std::int64_t c = first; c < last; ++c) out[c] += row[c];
    }
  });
}

class EdgeSums : public torch::autograd::Function<EdgeSums> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& at_target, const Tensor& at_source,
                        const Tensor& offsets, const Tensor& sources) {
    context->save_for_backward({offsets, sources});
    context->saved_data["source rows"] = at_source.size(0);
    const Tensor targets = at_target.contiguous(), from = at_source.contiguous();
    const std::int64_t channels = targets.size(1);
    Tensor out = torch::empty({sources.size(0), channels}, targets.options());
    const auto* starts = offsets.data_ptr<std::int64_t>();
    const auto* source = sources.data_ptr<std::int64_t>();
    AT_DISPATCH_FLOATING_TYPES(targets.scalar_type(), "edge_sums", [&] {
      const auto *own = targets.data_ptr<scalar_t>(), *other = from.data_ptr<scalar_t>();
      auto* sums = out.data_ptr<scalar_t>();
      at::parallel_for(0, targets.size(0), kLeastTargets, [&](std::int64_t first, std::int64_t last) {
        for (std::int64_t i = first; i < last; ++i) {
          const scalar_t* a = own + i * channels;
          for (std::int64_t e = starts[i]; e < starts[i + 1]; ++e) {
            const scalar_t* b = other + source[e] * channels;
            scalar_t* sum = sums + e * channels;
            for (std::int64_t c = 0; c < channels; ++c) sum[c] = a[c] + b[c];
          }
        }
      });
    });
    return out;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    TORCH_CHECK(!at::GradMode::is_enabled(), "edge sums can be differentiated once only");
    const variable_list saved = context->get_saved_variables();
    const Tensor slopes = gradients[0].contiguous();
    const std::int64_t targets = saved[0].size(0) - 1, edges = slopes.size(0), channels = slopes.size(1);
    Tensor d_target, d_source;
    AT_DISPATCH_FLOATING_TYPES(slopes.scalar_type(), "edge_sums_backward", [&] {
      const auto* rows = slopes.data_ptr<scalar_t>();
      if (context->needs_input_grad(0)) {
        d_target = torch::zeros({targets, channels}, slopes.options());
        sum_runs(rows, saved[0].data_ptr<std::int64_t>(), targets, channels, d_target.data_ptr<scalar_t>());
      }
      if (context->needs_input_grad(1)) {
        d_source = torch::zeros({context->saved_data["source rows"].toInt(), channels}, slopes.options());
        add_rows(rows, saved[1].data_ptr<std::int64_t>(), edges, channels, d_source.data_ptr<scalar_t>());
      }
    });
    return {d_target, d_source, Tensor(), Tensor()};
  }
};

class RunMaxima : public torch::autograd::Function<RunMaxima> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& values, const Tensor& offsets) {
    const Tensor rows = values.contiguous();
    const std::int64_t runs = offsets.size(0) - 1, channels = rows.size(1);
    Tensor out = torch::empty({runs, channels}, rows.options());
    Tensor chosen = torch::empty({runs, channels}, torch::kInt64);
    const auto* starts = offsets.data_ptr<std::int64_t>();
    auto* choice = chosen.data_ptr<std::int64_t>();
    AT_DISPATCH_FLOATING_TYPES(rows.scalar_type(), "run_maxima", [&] {
      const auto* all = rows.data_ptr<scalar_t>();
      auto* maxima = out.data_ptr<scalar_t>();
      at::parallel_for(0, runs, kLeastTargets, [&](std::int64_t first, std::int64_t last) {
        for (std::int64_t i = first; i < last; ++i) {
          scalar_t* best = maxima + i * channels;
          std::int64_t* from = choice + i * channels;
          for (std::int64_t c = 0; c < channels; ++c) {
            best[c] = all[starts[i] * channels + c];
            from[c] = starts[i];
          }
          for (std::int64_t e = starts[i] + 1; e < starts[i + 1]; ++e) {
            const scalar_t* row = all + e * channels;
            for (std::int64_t c = 0; c < channels; ++c) {
              if (!(row[c] > best[c]) && !std::isnan(row[c])) continue;
              best[c] = row[c];
              from[c] = e;
            }
          }
        }
      });
    });
    context->save_for_backward({chosen});
    context->saved_data["rows"] = rows.size(0);
    return out;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    TORCH_CHECK(!at::GradMode::is_enabled(), "run maxima can be differentiated once only");
    const Tensor chosen = context->get_saved_variables()[0], slopes = gradients[0].contiguous();
    Tensor d_values = torch::zeros({context->saved_data["rows"].toInt(), slopes.size(1)}, slopes.options());
    d_values.scatter_(0, chosen, slopes);  // a row belongs to one run, so no place is named twice
    return {d_values, Tensor()};
  }
};

void require_floating(const Tensor& x, const char* what) {
  require(x.defined() && x.is_floating_point(), what, "must hold floating-point numbers");
}

void require_runs(const Tensor& offsets, std::int64_t rows) {
  require_shape(offsets, {-1}, "offsets");
  require(offsets.scalar_type() == torch::kInt64 && offsets.size(0) >= 1, "offsets", "must be int64, at least one");
  const Tensor lengths = offsets.diff();
  require(offsets[0].item<std::int64_t>() == 0 && offsets[-1].item<std::int64_t>() == rows &&
              (lengths > 0).all().item<bool>(),
          "offsets", "must ascend from 0 to " + std::to_string(rows) + " without an empty run");
}

bool by_hand(const Tensor& x) {
  return x.is_cpu() && (x.scalar_type() == torch::kFloat32 || x.scalar_type() == torch::kFloat64);
}

}  // namespace

Tensor run_of_rows(const Tensor& offsets) {
  return torch::repeat_interleave(torch::arange(offsets.size(0) - 1, offsets.options()), offsets.diff());
}

Tensor indexed_edge_sums(const Tensor& at_target, const Tensor& at_source, const EdgeSet& edges) {
  return at_target.index_select(0, run_of_rows(edges.offsets)) + at_source.index_select(0, edges.sources);
}

Tensor scattered_maxima(const Tensor& values, const Tensor& offsets) {
  const Tensor runs = run_of_rows(offsets).unsqueeze(1).expand_as(values);
  const Tensor least =
      torch::full({offsets.size(0) - 1, values.size(1)}, -std::numeric_limits<double>::infinity(), values.options());
  return least.scatter_reduce(0, runs, values, "amax");
}

Tensor edge_sums(const Tensor& at_target, const Tensor& at_source, const EdgeSet& edges) {
  require_floating(at_target, "at_target");
  require_shape(at_target, {edges.targets(), -1}, "at_target");
  require_shape(at_source, {-1, at_target.size(1)}, "at_source");
  require(at_source.scalar_type() == at_target.scalar_type(), "at_source", "has another dtype than at_target");
  if (!by_hand(at_target)) return indexed_edge_sums(at_target, at_source, edges);
  require_runs(edges.offsets, edges.size());
  require(edges.sources.scalar_type() == torch::kInt64 && edges.size() > 0 &&
              edges.sources.min().item<std::int64_t>() >= 0 &&
              edges.sources.max().item<std::int64_t>() < at_source.size(0),
          "sources", "must be int64 indices of rows of at_source");
  return EdgeSums::apply(at_target, at_source, edges.offsets.contiguous(), edges.sources.contiguous());
}

Tensor run_maxima(const Tensor& values, const Tensor& offsets) {
  require_floating(values, "values");
  require_shape(values, {-1, -1}, "values");
  if (!by_hand(values)) return scattered_maxima(values, offsets);
  require_runs(offsets, values.size(0));
  return RunMaxima::apply(values, offsets.contiguous());
}

}  // namespace anigen::models::rignet
