#include "anigen/nn/cpu_ragged_attention.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/nn/cpu_bf16_attention.h"
#include "anigen/nn/cpu_ragged_bf16.h"
#include "anigen/nn/head_rows.h"
#include "anigen/nn/ragged_softmax.h"
#include "anigen/nn/ragged_tasks.h"
#include "anigen/nn/small_products.h"

namespace anigen::nn {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

// A block of scores with the rows it is made of stays in a second-level cache of half a MiB.
constexpr std::int64_t kForwardQueries = 128, kBackwardQueries = 64, kKeysAtOnce = 256;

std::int64_t at_most(std::int64_t longest, std::int64_t most) { return std::min(longest, most); }
std::int64_t key_block_rows(const RaggedProblem& problem) {
  return products::padded(at_most(problem.longest_keys, kKeysAtOnce));
}

struct ForwardScratch {
  explicit ForwardScratch(const RaggedProblem& p)
      : queries(at_most(p.longest_queries, kForwardQueries), p.width),
        keys(key_block_rows(p), p.width),
        keys_across(p.width, products::spread_stride(key_block_rows(p))),
        values(key_block_rows(p), p.width),
        scores(at_most(p.longest_queries, kForwardQueries), products::spread_stride(key_block_rows(p))),
        sums(at_most(p.longest_queries, kForwardQueries), p.width),
        state(at_most(p.longest_queries, kForwardQueries), 3) {}
  ScratchMatrix queries, keys, keys_across, values, scores, sums, state;
};

// What comes and what goes of a forward pass.
struct ForwardTensors {
  Tensor q, k, v, out, log_sums;
};

// What the next part reads first and writes, to be asked for during the products of this one.
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
    softmax_rows(scores, rows, columns, p.scale, state);
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
      : queries(at_most(p.longest_queries, kBackwardQueries), p.width),
        slopes_out(at_most(p.longest_queries, kBackwardQueries), p.width),
        keys(key_block_rows(p), p.width),
        values(key_block_rows(p), p.width),
        keys_across(p.width, products::spread_stride(key_block_rows(p))),
        values_across(p.width, products::spread_stride(key_block_rows(p))),
        scores(at_most(p.longest_queries, kBackwardQueries), products::spread_stride(key_block_rows(p))),
        slopes(at_most(p.longest_queries, kBackwardQueries), products::spread_stride(key_block_rows(p))),
        dq(p.longest_queries, p.width),
        dk(key_block_rows(p), p.width),
        dv(key_block_rows(p), p.width),
        delta(p.longest_queries, 1) {}
  ScratchMatrix queries, slopes_out, keys, values, keys_across, values_across, scores, slopes, dq, dk, dv, delta;
};

struct RaggedGradients {
  Tensor q, k, v, out, dy, log_sums;  // what the forward pass saved, and the gradient of its result
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
  for (const Tensor* x : {&g.dy, &g.out, &g.q, &g.dq}) {
    add_rows(ahead, HeadRows<T>(*x, next.head, row), queries, p.channels);
  }
  for (const Tensor* x : {&g.k, &g.v, &g.dk, &g.dv}) {
    add_rows(ahead, HeadRows<T>(*x, next.head, key_row), keys, p.channels);
  }
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
    read_rows(HeadRows<T>(g.dy, head, query_row + i), rows, p.channels, rows, dy);
    products::multiply({rows, columns, p.channels}, q.plain(), keys_across, scores, /*accumulate=*/false, ahead);
    products::multiply({rows, columns, p.channels}, dy.plain(), values_across, slopes, /*accumulate=*/false, ahead);
    for (std::int64_t r = 0; r < rows; ++r) {  // whole rows of vectors: what is behind the last column is not used
      kernels::softmax_backward_block(scores.from_row(r).values, slopes.from_row(r).values, 1, whole, p.scale,
                                      log_sums + i + r, scratch.delta.values() + i + r);
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
void backward_head(const RaggedProblem& p, const HeadTask& part, const HeadTask& next, const BackwardScratch& scratch,
                   const RaggedGradients& g) {
  const std::int64_t row = p.q_offsets[part.task->sequence], keys = p.keys(part.task->sequence);
  const std::int64_t queries = part.task->queries, block = even_block(keys, kKeysAtOnce);
  products::RowsAhead ahead = backward_rows<T>(p, part, next, g);
  dot_rows(HeadRows<T>(g.dy, part.head, row), HeadRows<T>(g.out, part.head, row), queries, p.channels,
           scratch.delta.values());
  for (std::int64_t first = 0; first < keys; first += block) {
    backward_block<T>(p, part, scratch, g, first, std::min(block, keys - first), ahead);
  }
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
                                   backward_head<T>(p, part, next, scratch, g);
                                 });
}

class CpuRaggedAttention : public torch::autograd::Function<CpuRaggedAttention> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& q, const Tensor& k, const Tensor& v,
                        const Tensor& q_offsets, const Tensor& k_offsets) {
    RECORD_USER_SCOPE("attention: sequences");
    const RaggedProblem problem(q, k, q_offsets, k_offsets);
    const Tensor out = torch::empty(q.sizes(), q.options());
    for (std::int64_t s = 0; s < problem.sequences; ++s) {
      if (problem.keys(s) == 0) out.narrow(0, problem.q_offsets[s], problem.queries(s)).zero_();
    }
    const Tensor log_sums = torch::empty({problem.heads, problem.rows}, torch::kFloat32);
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
    TORCH_CHECK(!at::GradMode::is_enabled(),
                "ragged attention can be differentiated once only: its backward pass, under "
                "create_graph, would miss terms");
    const variable_list saved = context->get_saved_variables();
    const Tensor &q = saved[0], &k = saved[1], &v = saved[2];
    const RaggedProblem problem(q, k, saved[5], saved[6]);
    const RaggedGradients g{q,
                            k,
                            v,
                            saved[3],
                            gradients[0].contiguous(),
                            saved[4],
                            torch::zeros(q.sizes(), q.options()),
                            torch::zeros(k.sizes(), k.options()),
                            torch::zeros(k.sizes(), k.options())};
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

// The kernels read rows whose channels are adjacent.
Tensor with_adjacent_channels(const Tensor& x) { return x.stride(2) == 1 ? x : x.contiguous(); }

}  // namespace

Tensor cpu_ragged_attention(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& q_offsets,
                            const Tensor& k_offsets) {
  return CpuRaggedAttention::apply(with_adjacent_channels(q), with_adjacent_channels(k), with_adjacent_channels(v),
                                   q_offsets, k_offsets);
}

}  // namespace anigen::nn
