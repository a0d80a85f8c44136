#include "anigen/sparse/tap_product.h"

namespace anigen::sparse {
namespace {

// Rows that a link joins, as indices of `in` and `out`.
struct LinkedRows {
  Tensor from, to;
};

LinkedRows linked_rows(const TapPlan& plan, const TapLink& link, const Tensor& neighbours) {
  const Tensor found = neighbours.select(0, link.tap);
  const Tensor rows = found.ge(0).nonzero().squeeze(1);
  return {found.index_select(0, rows).to(torch::kInt64) * plan.from_children + link.from_child,
          rows * plan.to_children + link.to_child};
}

}  // namespace

void add_tensor_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                            Tensor& out) {
  const Tensor weights = matrices.to(nn::dtype_of(in));
  for (const TapLink& link : plan.links) {
    const LinkedRows rows = linked_rows(plan, link, neighbours);
    const Tensor product = in.index_select(0, rows.from).mm(weights.select(0, link.matrix));
    out.index_add_(0, rows.to, product.to(nn::dtype_of(out)));
  }
}

Tensor tensor_tap_correlation(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes) {
  Tensor matrices = torch::empty({plan.matrices(), in.size(1), slopes.size(1)},
                                 in.options().dtype(nn::accumulation_dtype(nn::dtype_of(in))));
  for (const TapLink& link : plan.links) {
    const LinkedRows rows = linked_rows(plan, link, neighbours);
    matrices.select(0, link.matrix).copy_(in.index_select(0, rows.from).t().mm(slopes.index_select(0, rows.to)));
  }
  return matrices;
}

void add_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                     Tensor& out) {
  if (!in.is_cpu()) return add_tensor_tap_product(plan, neighbours, in, matrices, out);
  // The matrices of a subdivision are sums of weights, which bf16 would round once more.
  const bool plain = plan.from_children == 1 && plan.to_children == 1;
  if (plain && prefers_bf16_tap_product(in, matrices)) {
    return add_bf16_tap_product(plan, neighbours, in, matrices, out);
  }
  const torch::Dtype dtype = nn::dtype_of(out);
  add_cpu_tap_product(plan, neighbours, in.to(dtype), matrices.to(dtype), out);
}

Tensor tap_correlation(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes) {
  if (!in.is_cpu()) return tensor_tap_correlation(plan, neighbours, in, slopes);
  const torch::Dtype dtype = nn::accumulation_dtype(nn::dtype_of(in));
  return cpu_tap_correlation(plan, neighbours, in.to(dtype), slopes.to(dtype));
}

}  // namespace anigen::sparse
