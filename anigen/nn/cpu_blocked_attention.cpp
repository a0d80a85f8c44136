#include "anigen/nn/cpu_blocked_attention.h"

#include <ATen/Parallel.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/nn/attention_kernels.h"
#include "anigen/nn/blocked_attention.h"
#include "anigen/nn/cpu_bf16_attention.h"

namespace anigen::nn {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

// Scores in flight per thread: a quarter of a MiB, so that a second-level cache also holds the rows they are made of.
constexpr std::int64_t kMostQueries = 128, kMostKeys = 512;

// The sizes of a problem, and how it is cut: into as few blocks as possible, of about equal length.
struct AttentionPlan {
  AttentionPlan(std::int64_t query_rows, std::int64_t key_rows, std::int64_t head_channels)
      : queries(query_rows),
        keys(key_rows),
        channels(head_channels),
        query_block(block_length(query_rows, kMostQueries)),
        key_block(block_length(key_rows, kMostKeys)),
        scale(static_cast<float>(1.0 / std::sqrt(static_cast<double>(head_channels)))) {}

  static std::int64_t block_length(std::int64_t total, std::int64_t most) {
    const std::int64_t blocks = std::max<std::int64_t>(1, (total + most - 1) / most);
    return (total + blocks - 1) / blocks;
  }
  std::int64_t query_blocks() const { return (queries + query_block - 1) / query_block; }
  std::int64_t block_scores() const { return query_block * key_block; }
  std::int64_t forward_floats() const { return block_scores() + query_block * (channels + 3); }
  std::int64_t backward_floats() const { return 2 * block_scores(); }

  std::int64_t queries, keys, channels, query_block, key_block;
  float scale;
};

Tensor scratch_of(std::int64_t floats) { return torch::empty({floats}, torch::kFloat32); }

// The first rows · columns values of a part of the scratch as a dense matrix.
Tensor matrix_in(const Tensor& scratch, std::int64_t offset, std::int64_t rows, std::int64_t columns) {
  return scratch.narrow(0, offset, rows * columns).view({rows, columns});
}

// What the products of 16-bit inputs are formed in, where prefers_bf16_attention() does not know better.
Tensor for_products(const Tensor& x) { return x.to(torch::kFloat32); }

// out = a b, or out += a b, in the dtype of b. @param out fp32
void multiply(Tensor& out, const Tensor& a, const Tensor& b, bool accumulate) {
  if (dtype_of(b) != torch::kFloat32) {
    const Tensor product = at::mm(a.to(dtype_of(b)), b);
    if (accumulate) {
      out.add_(product);
    } else {
      out.copy_(product);
    }
  } else if (accumulate) {
    out.addmm_(a, b);
  } else {
    at::mm_out(out, a, b);
  }
}

// The queries first … first + rows of one head: the output, and the log-sum-exp of every row.
void attend_block(const AttentionPlan& plan, const Tensor& scratch, const Tensor& q, const Tensor& k, const Tensor& v,
                  Tensor out, float* log_sums) {
  const std::int64_t rows = q.size(0);
  Tensor values = matrix_in(scratch, plan.block_scores(), rows, plan.channels);
  float* state_values = scratch.data_ptr<float>() + plan.block_scores() + plan.query_block * plan.channels;
  const kernels::RunningSoftmax state{state_values, state_values + rows, state_values + 2 * rows};
  std::fill_n(state.largest, rows, -std::numeric_limits<float>::infinity());
  std::fill_n(state.sum, rows, 0.0F);
  for (std::int64_t first = 0; first < plan.keys; first += plan.key_block) {
    const std::int64_t columns = std::min(plan.key_block, plan.keys - first);
    Tensor scores = matrix_in(scratch, 0, rows, columns);
    multiply(scores, q, k.narrow(0, first, columns).t(), /*accumulate=*/false);
    kernels::softmax_block(scores.data_ptr<float>(), rows, columns, plan.scale, state);
    if (first > 0) kernels::scale_rows(values.data_ptr<float>(), rows, plan.channels, state.shrink);
    multiply(values, scores, v.narrow(0, first, columns), /*accumulate=*/first > 0);
  }
  kernels::softmax_finish(values.data_ptr<float>(), rows, plan.channels, plan.scale, state, out.data_ptr<float>(),
                          out.stride(0), log_sums);
}

// Rows of one head, all matrices [rows, D].
struct HeadGradients {
  Tensor q, k, v, dy, dq, dk, dv;
  const float *log_sums, *delta;
};

void backward_head(const AttentionPlan& plan, const Tensor& scratch, const HeadGradients& head) {
  for (std::int64_t i = 0; i < plan.queries; i += plan.query_block) {
    const std::int64_t rows = std::min(plan.query_block, plan.queries - i);
    const Tensor q = head.q.narrow(0, i, rows), dy = head.dy.narrow(0, i, rows);
    Tensor dq = head.dq.narrow(0, i, rows);
    for (std::int64_t j = 0; j < plan.keys; j += plan.key_block) {
      const std::int64_t columns = std::min(plan.key_block, plan.keys - j);
      const Tensor k = head.k.narrow(0, j, columns), v = head.v.narrow(0, j, columns);
      Tensor dk = head.dk.narrow(0, j, columns), dv = head.dv.narrow(0, j, columns);
      Tensor scores = matrix_in(scratch, 0, rows, columns);
      Tensor slopes = matrix_in(scratch, plan.block_scores(), rows, columns);
      multiply(scores, q, k.t(), /*accumulate=*/false);
      multiply(slopes, dy, v.t(), /*accumulate=*/false);
      kernels::softmax_backward_block(scores.data_ptr<float>(), slopes.data_ptr<float>(), rows, columns, plan.scale,
                                      head.log_sums + i, head.delta + i);
      multiply(dv, scores.t(), dy, /*accumulate=*/i > 0);
      multiply(dk, slopes.t(), q, /*accumulate=*/i > 0);
      multiply(dq, slopes, k, /*accumulate=*/j > 0);
    }
  }
}

// [B, ·, ·, D] → the matrix of batch item and head; `heads_at` says which axis counts heads.
Tensor head_of(const Tensor& x, std::int64_t index, std::int64_t heads, std::int64_t heads_at) {
  return x.select(0, index / heads).select(heads_at - 1, index % heads);
}

// [B, H, ·, D] → [B, N, H, D] in fp32, and the log-sum-exp of every row. @param log_sums [B · H, N]
Tensor attend_in_fp32(const Tensor& q, const Tensor& k, const Tensor& v, Tensor& log_sums) {
  const AttentionPlan plan(q.size(2), k.size(2), q.size(3));
  const std::int64_t batch = q.size(0), heads = q.size(1), blocks = plan.query_blocks();
  const Tensor q_rows = for_products(q), k_rows = for_products(k), v_rows = for_products(v);
  Tensor out = torch::empty({batch, plan.queries, heads, plan.channels}, torch::kFloat32);
  float* log_sums_data = log_sums.data_ptr<float>();
  at::parallel_for(0, batch * heads * blocks, 1, [&](std::int64_t begin, std::int64_t end) {
    const torch::NoGradGuard no_grad;  // a setting of the thread
    const Tensor scratch = scratch_of(plan.forward_floats());
    for (std::int64_t item = begin; item < end; ++item) {
      const std::int64_t head = item / blocks, first = item % blocks * plan.query_block;
      const std::int64_t rows = std::min(plan.query_block, plan.queries - first);
      attend_block(plan, scratch, head_of(q_rows, head, heads, 1).narrow(0, first, rows),
                   head_of(k_rows, head, heads, 1), head_of(v_rows, head, heads, 1),
                   head_of(out, head, heads, 2).narrow(0, first, rows), log_sums_data + head * plan.queries + first);
    }
  });
  return out;
}

// q, k, v as [B, H, ·, D]; the output as [B, N, H, D], as the layer that follows reads it.
class CpuBlockedAttention : public torch::autograd::Function<CpuBlockedAttention> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& q, const Tensor& k, const Tensor& v) {
    RECORD_USER_SCOPE("attention: dense");
    Tensor log_sums = torch::empty({q.size(0) * q.size(1), q.size(2)}, torch::kFloat32);
    const Tensor out = prefers_bf16_attention(q) ? cpu_bf16_attention(q, k, v, log_sums)
                                                 : attend_in_fp32(q, k, v, log_sums).to(dtype_of(q));
    context->save_for_backward({q, k, v, out, log_sums});
    return out;
  }

  // Parallel over heads: each head's sums for dk and dv are formed in one order.
  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("attention: dense");
    TORCH_CHECK(!at::GradMode::is_enabled(),
                "blocked attention can be differentiated once only: its backward pass, under "
                "create_graph, would miss terms");
    const variable_list saved = context->get_saved_variables();
    const Tensor &q = saved[0], &k = saved[1], &v = saved[2], &out = saved[3], &log_sums = saved[4];
    const AttentionPlan plan(q.size(2), k.size(2), q.size(3));
    const std::int64_t batch = q.size(0), heads = q.size(1);
    const Tensor q_rows = for_products(q), k_rows = for_products(k), v_rows = for_products(v);
    const Tensor dy = gradients[0].contiguous(), dy_rows = for_products(dy);
    // [B, N, H] → [B · H, N]
    const Tensor delta = (dy.to(torch::kFloat32) * out.to(torch::kFloat32)).sum(-1).transpose(1, 2).contiguous();
    const Tensor dq = torch::empty({batch, plan.queries, heads, plan.channels}, torch::kFloat32);
    const Tensor dk = torch::empty({batch, plan.keys, heads, plan.channels}, torch::kFloat32);
    const Tensor dv = torch::empty_like(dk);
    const float *log_sums_data = log_sums.data_ptr<float>(), *delta_data = delta.data_ptr<float>();
    at::parallel_for(0, batch * heads, 1, [&](std::int64_t begin, std::int64_t end) {
      const torch::NoGradGuard no_grad;
      const Tensor scratch = scratch_of(plan.backward_floats());
      for (std::int64_t i = begin; i < end; ++i) {
        backward_head(plan, scratch,
                      {head_of(q_rows, i, heads, 1), head_of(k_rows, i, heads, 1), head_of(v_rows, i, heads, 1),
                       head_of(dy_rows, i, heads, 2), head_of(dq, i, heads, 2), head_of(dk, i, heads, 2),
                       head_of(dv, i, heads, 2), log_sums_data + i * plan.queries, delta_data + i * plan.queries});
      }
    });
    const auto as_input = [&](const Tensor& gradient) { return gradient.transpose(1, 2).to(dtype_of(q)); };
    return {as_input(dq), as_input(dk), as_input(dv)};
  }
};

// The products read rows whose channels are adjacent.
Tensor with_dense_rows(const Tensor& x) { return x.stride(-1) == 1 ? x : x.contiguous(); }

}  // namespace

std::int64_t blocked_attention_scratch_bytes(std::int64_t queries, std::int64_t keys, std::int64_t head_channels) {
  const AttentionPlan plan(queries, keys, head_channels);
  const std::int64_t floats = std::max(plan.forward_floats(), plan.backward_floats());
  return floats * static_cast<std::int64_t>(sizeof(float));
}

Tensor cpu_blocked_attention(const Tensor& q, const Tensor& k, const Tensor& v) {
  return CpuBlockedAttention::apply(with_dense_rows(q), with_dense_rows(k), with_dense_rows(v)).transpose(1, 2);
}

}  // namespace anigen::nn
