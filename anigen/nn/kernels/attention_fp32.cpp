#include "anigen/nn/kernels/attention_fp32.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/nn/attention.h"
#include "anigen/nn/kernels/attention_bf16.h"
#include "anigen/nn/kernels/heads.h"
#include "anigen/nn/kernels/mixed_products.h"
#include "anigen/nn/kernels/softmax.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/profile.h"
#include "anigen/nn/ragged_attention.h"

namespace anigen::nn {

namespace {

// Scores in flight per thread: a quarter of a MiB, so that a second-level cache also holds the rows they are made of.
constexpr std::int64_t kMostQueries = 128, kMostKeys = 512;

// The sizes of a problem, and how it is cut: into as few blocks as possible, of about equal length.
struct AttentionPlan {
  AttentionPlan(std::int64_t query_rows, std::int64_t key_rows, std::int64_t head_channels)
      : queries(query_rows),
        keys(key_rows),
        channels(head_channels),
        query_block(even_block(query_rows, kMostQueries)),
        key_block(even_block(key_rows, kMostKeys)),
        scale(static_cast<float>(1.0 / std::sqrt(static_cast<double>(head_channels)))) {}

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

// Precision of the products of 16-bit inputs, where prefers_bf16_attention() does not know better.
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
    Tensor out = prefers_bf16_attention(q) ? cpu_bf16_attention(q, k, v, log_sums)
                                           : attend_in_fp32(q, k, v, log_sums).to(dtype_of(q));
    context->save_for_backward({q, k, v, out, log_sums});
    return out;
  }

  // Parallel over heads: each head's sums for dk and dv are formed in one order.
  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("attention: dense");
    const variable_list saved = saved_once(*context, "blocked attention");
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

// The products and the kernels read rows whose channels are adjacent.
Tensor with_adjacent_channels(const Tensor& x) { return x.stride(-1) == 1 ? x : x.contiguous(); }

void round_rows(const products::Block& block, std::int64_t rows, std::int64_t columns) {
  for (std::int64_t r = 0; r < rows; ++r) kernels::round_in_place(block.from_row(r).values, columns);
}

// A block of scores with the rows it is made of stays in a second-level cache of half a MiB.
constexpr std::int64_t kForwardQueries = 128, kBackwardQueries = 64, kKeysAtOnce = 256;

std::int64_t key_block_rows(const RaggedProblem& problem) {
  return products::padded(std::min(problem.longest_keys, kKeysAtOnce));
}

struct ForwardScratch {
  explicit ForwardScratch(const RaggedProblem& p)
      : queries(std::min(p.longest_queries, kForwardQueries), p.width),
        keys(key_block_rows(p), p.width),
        keys_across(p.width, products::spread_stride(key_block_rows(p))),
        values(key_block_rows(p), p.width),
        scores(std::min(p.longest_queries, kForwardQueries), products::spread_stride(key_block_rows(p))),
        sums(std::min(p.longest_queries, kForwardQueries), p.width),
        state(std::min(p.longest_queries, kForwardQueries), 3) {}
  ScratchMatrix queries, keys, keys_across, values, scores, sums, state;
};

// Inputs and outputs of a forward pass.
struct ForwardTensors {
  Tensor q, k, v, out, log_sums;
};

// Memory that the next part reads first and writes, to be asked for during the products of this one.
template <typename T>
products::RowsAhead forward_rows(const RaggedProblem& p, const HeadTask& part, const HeadTask& next,
                                 const ForwardTensors& t) {
  products::RowsAhead ahead;
  if (next.task == nullptr) return ahead;
  const std::int64_t row = p.q_offsets[next.task->sequence] + next.task->first_query;
  const std::int64_t key_row = p.k_offsets[next.task->sequence];
  const std::int64_t keys = even_block(p.keys(next.task->sequence), kKeysAtOnce);
  add_rows(ahead, HeadRows<T>(t.q, next.head, row), next.task->queries, p.channels);
  add_rows(ahead, HeadRows<T>(t.k, next.head, key_row), keys, p.channels);
  add_rows(ahead, HeadRows<T>(t.v, next.head, key_row), keys, p.channels);
  add_rows(ahead, HeadRows<T>(t.out, next.head, row), next.task->queries, p.channels);
  const std::int64_t now = p.keys(part.task->sequence);
  ahead.spread_over(products::asking_calls({part.task->queries, now, p.channels}) +
                    products::asking_calls({part.task->queries, p.channels, now}));
  return ahead;
}

// One head of the queries of a task: outputs, and the log-sum-exp of each.
template <typename T>
void attend_head(const RaggedProblem& p, const HeadTask& part, const HeadTask& next, const ForwardScratch& scratch,
                 const ForwardTensors& t) {
  const RaggedTask& task = *part.task;
  products::RowsAhead ahead = forward_rows<T>(p, part, next, t);
  const std::int64_t rows = task.queries, row = p.q_offsets[task.sequence] + task.first_query;
  const std::int64_t keys = p.keys(task.sequence), block = even_block(keys, kKeysAtOnce);
  const products::Block queries = scratch.queries.with_stride(p.width), sums = scratch.sums.with_stride(p.width);
  read_rows(HeadRows<T>(t.q, part.head, row), rows, p.channels, rows, queries);
  float* state_values = scratch.state.values();
  const kernels::RunningSoftmax state{state_values, state_values + rows, state_values + 2 * rows};
  std::fill_n(state.largest, rows, -std::numeric_limits<float>::infinity());
  std::fill_n(state.sum, rows, 0.0F);
  for (std::int64_t first = 0; first < keys; first += block) {
    const std::int64_t columns = std::min(block, keys - first), whole = products::padded(columns);
    const std::int64_t stride = products::spread_stride(columns), key_row = p.k_offsets[task.sequence] + first;
    const products::Block key_block = scratch.keys.with_stride(p.width), values = scratch.values.with_stride(p.width);
    const products::Block across = scratch.keys_across.with_stride(stride), scores = scratch.scores.with_stride(stride);
    read_rows(HeadRows<T>(t.k, part.head, key_row), columns, p.channels, whole, key_block);
    read_rows(HeadRows<T>(t.v, part.head, key_row), columns, p.channels, columns, values);
    products::transpose(whole, p.width, key_block, across);
    products::multiply({rows, columns, p.channels}, queries.plain(), across, scores, /*accumulate=*/false, ahead);
    kernels::softmax_rows(scores, rows, columns, p.scale, state);
    if (p.rounds_weights) round_rows(scores, rows, columns);
    if (first > 0) kernels::scale_rows(sums.values, rows, p.width, state.shrink);
    products::multiply({rows, p.channels, columns}, scores.plain(), values, sums, /*accumulate=*/first > 0, ahead);
  }
  float* const log_sums = t.log_sums.data_ptr<float>() + part.head * p.rows;
  for (std::int64_t r = 0; r < rows; ++r) {
    state.shrink[r] = 1.0F / state.sum[r];
    log_sums[row + r] = p.scale * state.largest[r] + std::log(state.sum[r]);
  }
  kernels::scale_rows(sums.values, rows, p.width, state.shrink);
  write_rows(sums, rows, p.channels, HeadRows<T>(t.out, part.head, row));
}

struct BackwardScratch {
  explicit BackwardScratch(const RaggedProblem& p)
      : queries(std::min(p.longest_queries, kBackwardQueries), p.width),
        slopes_out(std::min(p.longest_queries, kBackwardQueries), p.width),
        keys(key_block_rows(p), p.width),
        values(key_block_rows(p), p.width),
        keys_across(p.width, products::spread_stride(key_block_rows(p))),
        values_across(p.width, products::spread_stride(key_block_rows(p))),
        scores(std::min(p.longest_queries, kBackwardQueries), products::spread_stride(key_block_rows(p))),
        slopes(std::min(p.longest_queries, kBackwardQueries), products::spread_stride(key_block_rows(p))),
        dq(p.longest_queries, p.width),
        dk(key_block_rows(p), p.width),
        dv(key_block_rows(p), p.width),
        delta(p.longest_queries, 1) {}
  ScratchMatrix queries, slopes_out, keys, values, keys_across, values_across, scores, slopes, dq, dk, dv, delta;
};

struct RaggedGradients {
  Tensor q, k, v, out, dy, log_sums;  // what the forward pass saved, and the gradient of its result
  Tensor dy_factor;                   // dy where it is multiplied
  Tensor dq, dk, dv;
};

// As forward_rows.
template <typename T>
products::RowsAhead backward_rows(const RaggedProblem& p, const HeadTask& part, const HeadTask& next,
                                  const RaggedGradients& g) {
  products::RowsAhead ahead;
  if (next.task == nullptr) return ahead;
  const std::int64_t row = p.q_offsets[next.task->sequence], key_row = p.k_offsets[next.task->sequence];
  const std::int64_t queries = next.task->queries, keys = even_block(p.keys(next.task->sequence), kKeysAtOnce);
  for (const Tensor* x : {&g.dy, &g.dy_factor, &g.out, &g.q, &g.dq})
    add_rows(ahead, HeadRows<T>(*x, next.head, row), queries, p.channels);
  for (const Tensor* x : {&g.k, &g.v, &g.dk, &g.dv})
    add_rows(ahead, HeadRows<T>(*x, next.head, key_row), keys, p.channels);
  const std::int64_t now = p.keys(part.task->sequence);
  ahead.spread_over(2 * products::asking_calls({part.task->queries, now, p.channels}) +
                    2 * products::asking_calls({now, p.channels, part.task->queries}) +
                    products::asking_calls({part.task->queries, p.channels, now}));
  return ahead;
}

// All queries of a sequence against a block of its keys: the gradients of these keys, and their share in dq.
template <typename T>
void backward_block(const RaggedProblem& p, const HeadTask& part, const BackwardScratch& scratch,
                    const RaggedGradients& g, std::int64_t first_key, std::int64_t columns,
                    products::RowsAhead& ahead) {
  const RaggedTask& task = *part.task;
  const std::int64_t head = part.head;
  const std::int64_t query_row = p.q_offsets[task.sequence], key_row = p.k_offsets[task.sequence] + first_key;
  const std::int64_t whole = products::padded(columns), stride = products::spread_stride(columns);
  const std::int64_t block = even_block(task.queries, kBackwardQueries);
  const products::Block keys = scratch.keys.with_stride(p.width), values = scratch.values.with_stride(p.width);
  const products::Block keys_across = scratch.keys_across.with_stride(stride);
  const products::Block values_across = scratch.values_across.with_stride(stride);
  const products::Block scores = scratch.scores.with_stride(stride), slopes = scratch.slopes.with_stride(stride);
  const products::Block dk = scratch.dk.with_stride(p.width), dv = scratch.dv.with_stride(p.width);
  read_rows(HeadRows<T>(g.k, head, key_row), columns, p.channels, whole, keys);
  read_rows(HeadRows<T>(g.v, head, key_row), columns, p.channels, whole, values);
  products::transpose(whole, p.width, keys, keys_across);
  products::transpose(whole, p.width, values, values_across);
  const float* log_sums = g.log_sums.data_ptr<float>() + head * p.rows + query_row;
  for (std::int64_t i = 0; i < task.queries; i += block) {
    const std::int64_t rows = std::min(block, task.queries - i);
    const products::Block q = scratch.queries.with_stride(p.width), dy = scratch.slopes_out.with_stride(p.width);
    read_rows(HeadRows<T>(g.q, head, query_row + i), rows, p.channels, rows, q);
    read_rows(HeadRows<T>(g.dy_factor, head, query_row + i), rows, p.channels, rows, dy);
    products::multiply({rows, columns, p.channels}, q.plain(), keys_across, scores, /*accumulate=*/false, ahead);
    products::multiply({rows, columns, p.channels}, dy.plain(), values_across, slopes, /*accumulate=*/false, ahead);
    for (std::int64_t r = 0; r < rows; ++r) {  // whole rows of vectors: what is behind the last column is not used
      kernels::softmax_backward_block(scores.from_row(r).values, slopes.from_row(r).values, 1, whole, p.scale,
                                      log_sums + i + r, scratch.delta.values() + i + r);
    }
    if (p.rounds_weights) {
      round_rows(scores, rows, columns);
      round_rows(slopes, rows, columns);
    }
    const products::Block dq = scratch.dq.with_stride(p.width).from_row(i);
    products::multiply({columns, p.channels, rows}, scores.transposed(), dy, dv, /*accumulate=*/i > 0, ahead);
    products::multiply({columns, p.channels, rows}, slopes.transposed(), q, dk, /*accumulate=*/i > 0, ahead);
    products::multiply({rows, p.channels, columns}, slopes.plain(), keys, dq, /*accumulate=*/first_key > 0, ahead);
  }
  write_rows(dk, columns, p.channels, HeadRows<T>(g.dk, head, key_row));
  write_rows(dv, columns, p.channels, HeadRows<T>(g.dv, head, key_row));
}

template <typename T>
void backward_ragged_head(const RaggedProblem& p, const HeadTask& part, const HeadTask& next,
                          const BackwardScratch& scratch, const RaggedGradients& g) {
  const std::int64_t row = p.q_offsets[part.task->sequence], keys = p.keys(part.task->sequence);
  const std::int64_t queries = part.task->queries, block = even_block(keys, kKeysAtOnce);
  products::RowsAhead ahead = backward_rows<T>(p, part, next, g);
  dot_rows(HeadRows<T>(g.dy, part.head, row), HeadRows<T>(g.out, part.head, row), queries, p.channels,
           scratch.delta.values());
  for (std::int64_t first = 0; first < keys; first += block)
    backward_block<T>(p, part, scratch, g, first, std::min(block, keys - first), ahead);
  write_rows(scratch.dq.with_stride(p.width), queries, p.channels, HeadRows<T>(g.dq, part.head, row));
}

template <typename T>
void attend_all(const RaggedProblem& p, const ForwardTensors& tensors) {
  for_each_head<ForwardScratch>(p, ragged_tasks(p, kForwardQueries),
                                [&](const HeadTask& part, const HeadTask& next, const ForwardScratch& scratch) {
                                  attend_head<T>(p, part, next, scratch, tensors);
                                });
}

template <typename T>
void backward_all(const RaggedProblem& p, const RaggedGradients& g) {
  for_each_head<BackwardScratch>(p, ragged_tasks(p, std::numeric_limits<std::int32_t>::max()),
                                 [&](const HeadTask& part, const HeadTask& next, const BackwardScratch& scratch) {
                                   backward_ragged_head<T>(p, part, next, scratch, g);
                                 });
}

Tensor rounded(const Tensor& x) { return x.to(torch::kBFloat16); }

Tensor zeros_like(const Tensor& x, torch::Dtype dtype) { return torch::zeros(x.sizes(), dtype); }

class CpuRaggedAttention : public torch::autograd::Function<CpuRaggedAttention> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& q, const Tensor& k, const Tensor& v,
                        const Tensor& q_offsets, const Tensor& k_offsets) {
    RECORD_USER_SCOPE("attention: sequences");
    RaggedProblem problem(q, k, q_offsets, k_offsets);
    problem.rounds_weights = prefers_mixed_attention(q) && emulated_mixed_products();
    context->saved_data["emulated"] = problem.rounds_weights;
    count_operations(2.0 * problem.product_operations(), prefers_mixed_attention(q) || prefers_bf16_attention(q));
    const Tensor out = torch::empty(q.sizes(), q.options());
    for (std::int64_t s = 0; s < problem.sequences; ++s) {
      if (problem.keys(s) == 0) out.narrow(0, problem.q_offsets[s], problem.queries(s)).zero_();
    }
    const Tensor log_sums = torch::empty({problem.heads, problem.rows}, torch::kFloat32);
    if (problem.rounds_weights) {
      const Tensor rounded_q = rounded_factor(q), rounded_k = rounded_factor(k), rounded_v = rounded_factor(v);
      attend_all<float>(problem, {rounded_q, rounded_k, rounded_v, out, log_sums});
      context->save_for_backward({rounded_q, rounded_k, rounded_v, out, log_sums, q_offsets, k_offsets});
      return out;
    }
    if (prefers_mixed_attention(q)) {
      const Tensor rounded_q = rounded(q), rounded_k = rounded(k), rounded_v = rounded(v);
      attend_ragged_bf16(problem, rounded_q, rounded_k, rounded_v, out, log_sums);
      context->save_for_backward({rounded_q, rounded_k, rounded_v, out, log_sums, q_offsets, k_offsets});
      return out;
    }
    if (prefers_bf16_attention(q)) {
      attend_ragged_bf16(problem, q, k, v, out, log_sums);
    } else if (dtype_of(q) == torch::kBFloat16) {
      attend_all<c10::BFloat16>(problem, {q, k, v, out, log_sums});
    } else if (dtype_of(q) == torch::kHalf) {
      attend_all<c10::Half>(problem, {q, k, v, out, log_sums});
    } else {
      attend_all<float>(problem, {q, k, v, out, log_sums});
    }
    context->save_for_backward({q, k, v, out, log_sums, q_offsets, k_offsets});
    return out;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("attention: sequences");
    const variable_list saved = saved_once(*context, "ragged attention");
    const Tensor &q = saved[0], &k = saved[1], &v = saved[2];
    RaggedProblem problem(q, k, saved[5], saved[6]);
    problem.rounds_weights = context->saved_data["emulated"].toBool();
    const Tensor dy = gradients[0].contiguous();
    count_operations(5.0 * problem.product_operations(), dtype_of(q) != dtype_of(saved[3]));
    if (dtype_of(q) != dtype_of(saved[3])) {
      const auto zeros = [](const Tensor& like) { return zeros_like(like, torch::kFloat32); };
      const MixedAttentionGradients mixed{q, k, v, saved[3], saved[4], dy, rounded(dy), zeros(q), zeros(k), zeros(k)};
      mixed_attention_backward(problem, mixed);
      return {mixed.dq, mixed.dk, mixed.dv, Tensor(), Tensor()};
    }
    const auto zeros = [](const Tensor& like) { return zeros_like(like, dtype_of(like)); };
    const Tensor factor = problem.rounds_weights ? rounded_factor(dy) : dy;
    const RaggedGradients g{q, k, v, saved[3], dy, saved[4], factor, zeros(q), zeros(k), zeros(k)};
    if (dtype_of(q) == torch::kBFloat16) {
      backward_all<c10::BFloat16>(problem, g);
    } else if (dtype_of(q) == torch::kHalf) {
      backward_all<c10::Half>(problem, g);
    } else {
      backward_all<float>(problem, g);
    }
    return {g.dq, g.dk, g.dv, Tensor(), Tensor()};
  }
};

}  // namespace

std::int64_t blocked_attention_scratch_bytes(std::int64_t queries, std::int64_t keys, std::int64_t head_channels) {
  const AttentionPlan plan(queries, keys, head_channels);
  const std::int64_t floats = std::max(plan.forward_floats(), plan.backward_floats());
  return floats * static_cast<std::int64_t>(sizeof(float));
}

Tensor cpu_blocked_attention(const Tensor& q, const Tensor& k, const Tensor& v) {
  return CpuBlockedAttention::apply(with_adjacent_channels(q), with_adjacent_channels(k), with_adjacent_channels(v))
      .transpose(1, 2);
}

Tensor cpu_ragged_attention(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& q_offsets,
                            const Tensor& k_offsets) {
  return CpuRaggedAttention::apply(with_adjacent_channels(q), with_adjacent_channels(k), with_adjacent_channels(v),
                                   q_offsets, k_offsets);
}

}  // namespace anigen::nn
