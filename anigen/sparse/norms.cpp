#include "anigen/sparse/norms.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>
#include <vector>

#include "anigen/nn/init.h"
#include "anigen/nn/kernels/activations.h"

namespace anigen::sparse {

namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

// Rows that pass through the operations of a sum while they are in the cache.
std::int64_t norm_block_rows(const Tensor& rows) {
  constexpr std::int64_t kCachedValues = 65536, kFewest = 64, kMost = 4096;
  if (!rows.is_cpu()) return std::max<std::int64_t>(1, rows.size(0));
  return std::clamp(kCachedValues / std::max<std::int64_t>(1, rows.size(1)), kFewest, kMost);
}

// Calls body(block, first row, rows) for all blocks.
template <typename Body>
void for_each_norm_block(const Tensor& rows, const Body& body) {
  const std::int64_t length = norm_block_rows(rows), count = (rows.size(0) + length - 1) / length;
  at::parallel_for(0, count, 1, [&](std::int64_t begin, std::int64_t end) {
    const torch::NoGradGuard no_grad;  // a setting of the thread
    for (std::int64_t block = begin; block < end; ++block) {
      const std::int64_t first = block * length;
      body(block, first, std::min(length, rows.size(0) - first));
    }
  });
}

// Σ over all rows of body(first, count) [S, C], which sums over some of them: added up in fp64, in the order of the
// rows.
template <typename Body>
Tensor block_sums(const Tensor& rows, std::int64_t sums, const Body& body) {
  const std::int64_t length = norm_block_rows(rows), count = (rows.size(0) + length - 1) / length;
  Tensor parts =
      torch::zeros({count, sums, rows.size(1)}, rows.options().dtype(nn::accumulation_dtype(nn::dtype_of(rows))));
  for_each_norm_block(rows, [&](std::int64_t block, std::int64_t first, std::int64_t some) {
    parts.select(0, block).copy_(body(first, some));
  });
  return parts.to(torch::kFloat64).sum(0);
}

// Sum over the channels of each group, for every channel of it. @param values [C]
Tensor over_group(const Tensor& values, std::int64_t groups) {
  const std::int64_t members = values.size(0) / groups;
  return values.view({groups, members}).sum(1, /*keepdim=*/true).expand({groups, members}).reshape({-1});
}

// The rows of one item; statistics per channel, equal within a group, and the parameters, in the type of sums.
struct NormItem {
  Tensor rows, mean, rstd;
  torch::Dtype wide;

  double members(std::int64_t groups) const { return static_cast<double>(rows.numel()) / static_cast<double>(groups); }
  Tensor centred(std::int64_t first, std::int64_t count) const { return rows.narrow(0, first, count).to(wide) - mean; }
};

// The mean first, then the variance around it: the difference of two sums of squares would lose digits.
NormItem norm_statistics(const Tensor& rows, std::int64_t groups, double eps) {
  NormItem item{rows, Tensor(), Tensor(), nn::accumulation_dtype(nn::dtype_of(rows))};
  const Tensor sums = block_sums(rows, 1, [&](std::int64_t first, std::int64_t count) {
    return rows.narrow(0, first, count).to(item.wide).sum(0, /*keepdim=*/true);
  });
  item.mean = (over_group(sums[0], groups) / item.members(groups)).to(item.wide);
  const Tensor squares = block_sums(rows, 1, [&](std::int64_t first, std::int64_t count) {
    return item.centred(first, count).square_().sum(0, /*keepdim=*/true);
  });
  item.rstd = (over_group(squares[0], groups) / item.members(groups) + eps).rsqrt().to(item.wide);
  return item;
}

class GroupNormFunction : public torch::autograd::Function<GroupNormFunction> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& feats, const Tensor& weight, const Tensor& bias,
                        const std::vector<std::int64_t>& lengths, std::int64_t groups, double eps) {
    RECORD_USER_SCOPE("elementwise and copies: group norm");
    const torch::Dtype wide = nn::accumulation_dtype(nn::dtype_of(feats));
    const Tensor scale = weight.to(wide), shift = bias.to(wide);
    const Tensor out = torch::empty_like(feats);
    const auto statistics = static_cast<std::int64_t>(lengths.size());
    const Tensor means = torch::zeros({statistics, feats.size(1)}, feats.options().dtype(wide));
    const Tensor rstds = torch::zeros_like(means);
    std::int64_t offset = 0;
    for (std::size_t i = 0; i < lengths.size(); offset += lengths[i], ++i) {
      if (lengths[i] == 0) continue;
      const NormItem item = norm_statistics(feats.narrow(0, offset, lengths[i]), groups, eps);
      const Tensor normed = out.narrow(0, offset, lengths[i]), factor = item.rstd * scale;
      for_each_norm_block(item.rows, [&](std::int64_t, std::int64_t first, std::int64_t count) {
        normed.narrow(0, first, count).copy_(item.centred(first, count).mul_(factor).add_(shift));
      });
      means[static_cast<std::int64_t>(i)].copy_(item.mean);
      rstds[static_cast<std::int64_t>(i)].copy_(item.rstd);
    }
    context->save_for_backward({feats, weight, means, rstds});
    context->saved_data["lengths"] = lengths;
    context->saved_data["groups"] = groups;
    return out;
  }

  // With x̂ = (x − μ) r and sums over the M values of a group of an item:
  // dx = r (w dy − (Σ w dy + x̂ Σ w dy x̂) / M), dw = Σ dy x̂, db = Σ dy.
  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("elementwise and copies: group norm");
    const torch::autograd::variable_list saved = nn::saved_once(*context, "sparse group norm");
    const Tensor &feats = saved[0], &weight = saved[1], &means = saved[2], &rstds = saved[3], &slopes = gradients[0];
    const std::vector<std::int64_t> lengths = context->saved_data["lengths"].toIntVector();
    const std::int64_t groups = context->saved_data["groups"].toInt();
    const torch::Dtype wide = nn::dtype_of(means);
    const Tensor scale = weight.to(torch::kFloat64);
    const Tensor d_feats = torch::empty_like(feats);
    Tensor d_weight = torch::zeros_like(scale), d_bias = torch::zeros_like(scale);
    std::int64_t offset = 0;
    for (std::size_t i = 0; i < lengths.size(); offset += lengths[i], ++i) {
      if (lengths[i] == 0) continue;
      const auto index = static_cast<std::int64_t>(i);
      const NormItem item{feats.narrow(0, offset, lengths[i]), means[index], rstds[index], wide};
      const Tensor dy = slopes.narrow(0, offset, lengths[i]), dx = d_feats.narrow(0, offset, lengths[i]);
      const Tensor sums = block_sums(item.rows, 2, [&](std::int64_t first, std::int64_t count) {
        const Tensor some = dy.narrow(0, first, count).to(wide);
        return torch::stack({some.sum(0), item.centred(first, count).mul_(some).sum(0)});
      });
      const Tensor rstd = item.rstd.to(torch::kFloat64), with_unit = sums[1] * rstd;
      d_bias.add_(sums[0]);
      d_weight.add_(with_unit);
      const double members = item.members(groups);
      const Tensor of_slope = (scale * rstd).to(wide);
      const Tensor constant = (over_group(scale * sums[0], groups) * rstd / -members).to(wide);
      const Tensor of_centred = (over_group(scale * with_unit, groups) * rstd.square() / -members).to(wide);
      for_each_norm_block(item.rows, [&](std::int64_t, std::int64_t first, std::int64_t count) {
        const Tensor values = item.centred(first, count).mul_(of_centred).add_(constant);
        dx.narrow(0, first, count).copy_(values.addcmul_(dy.narrow(0, first, count).to(wide), of_slope));
      });
    }
    return {d_feats, d_weight.to(nn::dtype_of(weight)), d_bias.to(nn::dtype_of(weight)), Tensor(), Tensor(), Tensor()};
  }
};

// Numbers of a channel or a group: how many, their mean and the sum of squares around it.
struct Moments {
  double count = 0.0, mean = 0.0, squares = 0.0;

  // Chan, Golub and LeVeque 1979: δ = μ_b − μ_a, μ = μ_a + δ n_b / n, S = S_a + S_b + δ² n_a n_b / n.
  void add(const Moments& b) {
    const double all = count + b.count, beyond = b.mean - mean;
    mean += beyond * b.count / all;
    squares += b.squares + beyond * beyond * count * b.count / all;
    count = all;
  }
};

// Means and 1 / σ of all items, equal within a group. @param means, rstds [items, C], of items without rows untouched
void group_statistics(const Tensor& feats, const std::vector<nn::RowBlock>& blocks, std::int64_t groups, double eps,
                      const Tensor& means, const Tensor& rstds) {
  const std::int64_t channels = feats.size(1), members = channels / groups;
  const Tensor parts = torch::empty({static_cast<std::int64_t>(blocks.size()), 2, channels}, feats.options());
  const float* x = feats.data_ptr<float>();
  float* part = parts.data_ptr<float>();
  nn::for_each_block(blocks, [&](const nn::RowBlock& block, std::int64_t number) {
    float* const mean = part + 2 * number * channels;
    nn::kernels::column_moments(x + block.first * channels, block.count, channels, mean, mean + channels);
  });
  std::vector<Moments> of_groups(static_cast<std::size_t>(means.size(0) * groups));
  for (const nn::RowBlock& block : blocks) {
    for (std::int64_t c = 0; c < channels; ++c) {
      of_groups[static_cast<std::size_t>(block.item * groups + c / members)].add(
          {static_cast<double>(block.count), static_cast<double>(part[c]), static_cast<double>(part[channels + c])});
    }
    part += 2 * channels;
  }
  for (std::int64_t i = 0; i < means.numel(); ++i) {
    const Moments& group = of_groups[static_cast<std::size_t>(i / members)];
    if (group.count == 0.0) continue;
    means.data_ptr<float>()[i] = static_cast<float>(group.mean);
    rstds.data_ptr<float>()[i] = static_cast<float>(1.0 / std::sqrt(group.squares / group.count + eps));
  }
}

// GroupNormFunction for fp32 in CPU memory, by kernels: one pass for the statistics and one for the result, which SiLU
// is applied to if asked for.
class ColumnGroupNorm : public torch::autograd::Function<ColumnGroupNorm> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& feats, const Tensor& weight, const Tensor& bias,
                        const std::vector<std::int64_t>& lengths, std::int64_t groups, double eps, bool silu) {
    RECORD_USER_SCOPE("elementwise and copies: group norm");
    const std::vector<nn::RowBlock> blocks = nn::row_blocks(lengths, feats.size(1));
    const Tensor means = torch::zeros({static_cast<std::int64_t>(lengths.size()), feats.size(1)}, feats.options());
    const Tensor rstds = torch::zeros_like(means), shift = bias.contiguous();
    group_statistics(feats, blocks, groups, eps, means, rstds);
    const Tensor factors = rstds * weight, out = torch::empty_like(feats);
    nn::for_each_block(blocks, [&](const nn::RowBlock& block, std::int64_t) {
      const std::int64_t first = block.first * feats.size(1);
      nn::kernels::norm_columns(columns_of(block, means, factors, shift, silu), feats.data_ptr<float>() + first,
                                out.data_ptr<float>() + first);
    });
    context->save_for_backward({feats, weight, shift, means, rstds});
    context->saved_data["lengths"] = lengths;
    context->saved_data["groups"] = groups;
    context->saved_data["silu"] = silu;
    return out;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("elementwise and copies: group norm");
    const variable_list saved = nn::saved_once(*context, "sparse group norm");
    const Tensor &feats = saved[0], &weight = saved[1], &shift = saved[2], &means = saved[3], &rstds = saved[4];
    const std::vector<std::int64_t> lengths = context->saved_data["lengths"].toIntVector();
    const std::int64_t groups = context->saved_data["groups"].toInt(), channels = feats.size(1);
    const bool silu = context->saved_data["silu"].toBool();
    const Tensor slopes = gradients[0].contiguous(), factors = rstds * weight, d_feats = torch::empty_like(feats);
    const std::vector<nn::RowBlock> blocks = nn::row_blocks(lengths, channels);
    const Tensor parts = torch::empty({static_cast<std::int64_t>(blocks.size()), 2, channels}, feats.options());
    const float* x = feats.data_ptr<float>();
    float* dx = d_feats.data_ptr<float>();
    nn::for_each_block(blocks, [&](const nn::RowBlock& block, std::int64_t number) {
      float* const sum = parts.data_ptr<float>() + 2 * number * channels;
      const std::int64_t first = block.first * channels;
      nn::kernels::norm_columns_slopes(columns_of(block, means, factors, shift, silu), x + first,
                                       slopes.data_ptr<float>() + first, dx + first, sum, sum + channels);
    });

    // With x̂ = (x − μ) r, d = dy ∂y/∂u and sums over the M values of a group of an item:
    // dx = r (w d − (Σ w d + x̂ Σ w d x̂) / M), dw = Σ d x̂, db = Σ d.
    const Tensor sums = torch::zeros({means.size(0), 2, channels}, feats.options().dtype(torch::kFloat64));
    const float* part = parts.data_ptr<float>();
    for (const nn::RowBlock& block : blocks) {
      double* const sum = sums.data_ptr<double>() + 2 * block.item * channels;
      for (std::int64_t c = 0; c < 2 * channels; ++c) sum[c] += static_cast<double>(*part++);
    }
    const Tensor rstd = rstds.to(torch::kFloat64), scale = weight.to(torch::kFloat64);
    const Tensor plain = sums.select(1, 0), with_unit = sums.select(1, 1) * rstd;
    const Tensor counts = torch::tensor(lengths, torch::kFloat64).unsqueeze(1) * (channels / groups);
    const auto mean_of_group = [&](const Tensor& values) {
      const Tensor grouped = (scale * values).view({-1, groups, channels / groups}).sum(2, /*keepdim=*/true);
      return grouped.expand({-1, groups, channels / groups}).reshape(means.sizes()) / counts;
    };
    const Tensor of_slope = (scale * rstd).to(torch::kFloat32);
    const Tensor of_centred = (-mean_of_group(with_unit) * rstd.square()).to(torch::kFloat32);
    const Tensor constant = (-mean_of_group(plain) * rstd).to(torch::kFloat32);
    nn::for_each_block(blocks, [&](const nn::RowBlock& block, std::int64_t) {
      const std::int64_t of_item = block.item * channels, first = block.first * channels;
      nn::kernels::norm_columns_backward(block.count, channels, x + first, means.data_ptr<float>() + of_item,
                                         {of_slope.data_ptr<float>() + of_item, of_centred.data_ptr<float>() + of_item,
                                          constant.data_ptr<float>() + of_item},
                                         dx + first);
    });
    const torch::Dtype dtype = nn::dtype_of(weight);
    return {d_feats, with_unit.sum(0).to(dtype), plain.sum(0).to(dtype), Tensor(), Tensor(), Tensor(), Tensor()};
  }

 private:
  static nn::kernels::ColumnNorm columns_of(const nn::RowBlock& block, const Tensor& means, const Tensor& factors,
                                            const Tensor& shift, bool silu) {
    const std::int64_t channels = means.size(1), item = block.item * channels;
    return {block.count,
            channels,
            means.data_ptr<float>() + item,
            factors.data_ptr<float>() + item,
            shift.data_ptr<float>(),
            silu};
  }
};

}  // namespace

Tensor sparse_group_norm(const Tensor& feats, const nn::Ragged& items, const Tensor& weight, const Tensor& bias,
                         std::int64_t groups, double eps, bool silu) {
  TORCH_CHECK(feats.dim() == 2 && feats.size(0) == items.rows() && feats.size(1) == weight.size(0) &&
                  feats.size(1) == bias.size(0) && groups > 0 && feats.size(1) % groups == 0,
              "sparse group norm in ", groups, " groups, weight ", nn::shape_text(weight), ", at ", items.rows(),
              " voxels: features ", nn::shape_text(feats));
  const Tensor rows = feats.contiguous();
  const bool by_kernels = rows.is_cpu() && nn::dtype_of(rows) == torch::kFloat32 &&
                          nn::dtype_of(weight) == torch::kFloat32 && nn::dtype_of(bias) == torch::kFloat32;
  if (by_kernels) return ColumnGroupNorm::apply(rows, weight, bias, items.lengths(), groups, eps, silu);
  Tensor normed = GroupNormFunction::apply(rows, weight, bias, items.lengths(), groups, eps);
  if (!silu) return normed;
  // Without a gradient in place: at 256³ every copy of the features counts.
  return at::GradMode::is_enabled() ? torch::silu(normed) : at::silu_(normed);
}

SparseGroupNormImpl::SparseGroupNormImpl(std::int64_t channels, std::int64_t groups, double eps)
    : groups_(groups), eps_(eps) {
  TORCH_CHECK(groups > 0 && channels % groups == 0, "sparse group norm: ", channels, " channels do not divide into ",
              groups, " groups");
  weight = register_parameter("weight", torch::empty({channels}));
  bias = register_parameter("bias", torch::empty({channels}));
}

SparseTensor SparseGroupNormImpl::forward(const SparseTensor& x, bool silu) {
  return x.with(sparse_group_norm(x.feats, x.support->items(), weight, bias, groups_, eps_, silu));
}

void default_group_norms(torch::nn::Module& module) {
  module.apply([](torch::nn::Module& part) {
    auto* norm = part.as<SparseGroupNormImpl>();
    if (norm == nullptr) return;
    torch::nn::init::ones_(norm->weight);
    torch::nn::init::zeros_(norm->bias);
  });
}

}  // namespace anigen::sparse
