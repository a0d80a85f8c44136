#include "anigen/sparse/norms.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <vector>

#include "anigen/nn/init.h"

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

}  // namespace

Tensor sparse_group_norm(const Tensor& feats, const nn::Ragged& items, const Tensor& weight, const Tensor& bias,
                         std::int64_t groups, double eps) {
  TORCH_CHECK(feats.dim() == 2 && feats.size(0) == items.rows() && feats.size(1) == weight.size(0) &&
                  feats.size(1) == bias.size(0) && groups > 0 && feats.size(1) % groups == 0,
              "sparse group norm in ", groups, " groups, weight ", nn::shape_text(weight), ", at ", items.rows(),
              " voxels: features ", nn::shape_text(feats));
  return GroupNormFunction::apply(feats.contiguous(), weight, bias, items.lengths(), groups, eps);
}

SparseGroupNormImpl::SparseGroupNormImpl(std::int64_t channels, std::int64_t groups, double eps)
    : groups_(groups), eps_(eps) {
  TORCH_CHECK(groups > 0 && channels % groups == 0, "sparse group norm: ", channels, " channels do not divide into ",
              groups, " groups");
  weight = register_parameter("weight", torch::empty({channels}));
  bias = register_parameter("bias", torch::empty({channels}));
}

SparseTensor SparseGroupNormImpl::forward(const SparseTensor& x) {
  return x.with(sparse_group_norm(x.feats, x.support->items(), weight, bias, groups_, eps_));
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
