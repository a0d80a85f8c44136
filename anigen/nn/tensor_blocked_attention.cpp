#include "anigen/nn/tensor_blocked_attention.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace anigen::nn {
namespace {

double score_scale(const Tensor& q) { return 1.0 / std::sqrt(static_cast<double>(q.size(-1))); }

// Scaled scores of some queries with all keys, in the type of sums.
Tensor wide_scores(const Tensor& q_rows, const Tensor& k) {
  const Tensor scores = torch::matmul(q_rows * score_scale(q_rows), k.transpose(-2, -1));
  return scores.to(accumulation_dtype(dtype_of(scores)));
}

class TensorBlockedAttention : public torch::autograd::Function<TensorBlockedAttention> {
 public:
  static Tensor forward(torch::autograd::AutogradContext* context, const Tensor& q, const Tensor& k, const Tensor& v,
                        std::int64_t rows) {
    std::vector<Tensor> out, log_sums;
    for (std::int64_t i = 0; i < q.size(2); i += rows) {
      const Tensor scores = wide_scores(q.narrow(2, i, std::min(rows, q.size(2) - i)), k);
      log_sums.push_back(scores.logsumexp(-1, /*keepdim=*/true));
      out.push_back(torch::matmul((scores - log_sums.back()).exp_().to(dtype_of(q)), v));
    }
    const Tensor result = torch::cat(out, 2);
    context->save_for_backward({q, k, v, result, torch::cat(log_sums, 2)});
    context->saved_data["rows"] = rows;
    return result;
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list gradients) {
    TORCH_CHECK(!at::GradMode::is_enabled(),
                "blocked attention can be differentiated once only: its backward pass, under "
                "create_graph, would miss terms");
    const torch::autograd::variable_list saved = context->get_saved_variables();
    const Tensor &q = saved[0], &k = saved[1], &v = saved[2], &out = saved[3], &log_sums = saved[4], &dy = gradients[0];
    const std::int64_t rows = context->saved_data["rows"].toInt();
    const torch::Dtype dtype = dtype_of(q), wide = dtype_of(log_sums);
    const Tensor delta = (dy.to(wide) * out.to(wide)).sum(-1, /*keepdim=*/true);
    Tensor dk = torch::zeros(k.sizes(), k.options().dtype(wide)), dv = torch::zeros_like(dk);
    std::vector<Tensor> dq;
    for (std::int64_t i = 0; i < q.size(2); i += rows) {
      const auto block = [&](const Tensor& x) { return x.narrow(2, i, std::min(rows, x.size(2) - i)); };
      const Tensor q_rows = block(q), dy_rows = block(dy);
      const Tensor weights = (wide_scores(q_rows, k) - block(log_sums)).exp_();
      const Tensor slopes = torch::matmul(dy_rows, v.transpose(-2, -1)).to(wide);
      const Tensor dscores = ((slopes - block(delta)).mul_(weights) * score_scale(q)).to(dtype);
      dv.add_(torch::matmul(weights.to(dtype).transpose(-2, -1), dy_rows));
      dk.add_(torch::matmul(dscores.transpose(-2, -1), q_rows));
      dq.push_back(torch::matmul(dscores, k));
    }
    return {torch::cat(dq, 2), dk.to(dtype), dv.to(dtype), Tensor()};
  }
};

}  // namespace

Tensor tensor_blocked_attention(const Tensor& q, const Tensor& k, const Tensor& v, std::int64_t rows) {
  return TensorBlockedAttention::apply(q, k, v, rows);
}

}  // namespace anigen::nn
