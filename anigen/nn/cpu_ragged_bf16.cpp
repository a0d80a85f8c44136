#include "anigen/nn/cpu_ragged_bf16.h"

#include <algorithm>
#include <vector>

#include "anigen/nn/bf16_attention_kernels.h"
#include "anigen/nn/bf16_bits.h"
#include "anigen/nn/head_rows.h"

namespace anigen::nn {
namespace {

namespace bf16 = nn::kernels;

std::uint16_t* row_of(const Tensor& x, std::int64_t head, std::int64_t row) {
  return bf16_bits(x) + head * x.stride(1) + row * x.stride(0);
}

// Queries of a task: a window of 8³ on a surface has up to 140 voxels.
constexpr std::int64_t kTaskQueries = 192;
constexpr std::int64_t kOwnKeys = 1024;  // as packed, 256 KiB with 64 channels

// A sequence whose queries make one task: the task packs its keys itself, and they never leave the cache.
bool is_one_task(const RaggedProblem& problem, std::int64_t sequence) {
  return problem.queries(sequence) <= kTaskQueries && problem.keys(sequence) <= kOwnKeys;
}

// Keys and values of one head of a sequence as the kernels read them.
void pack(const RaggedProblem& problem, const Tensor& k, const Tensor& v, std::int64_t sequence, std::int64_t head,
          std::uint16_t* keys, std::uint16_t* values) {
  const std::int64_t first = problem.k_offsets[sequence], count = problem.keys(sequence), channels = problem.channels;
  bf16::pack_bf16_keys(row_of(k, head, first), k.stride(0), count, channels, keys);
  bf16::pack_bf16_values(row_of(v, head, first), v.stride(0), count, channels, values);
}

// Those of all heads of the sequences that several tasks share.
class PackedSequences {
 public:
  PackedSequences(const RaggedProblem& problem, const Tensor& k, const Tensor& v)
      : heads_(problem.heads), starts_(static_cast<std::size_t>(problem.sequences) + 1, 0) {
    for (std::int64_t s = 0; s < problem.sequences; ++s) {
      const bool shared = !is_one_task(problem, s);
      starts_[static_cast<std::size_t>(s) + 1] =
          start(s) + (shared ? bf16::packed_bf16_size(problem.keys(s), problem.channels) : 0);
    }
    numbers_ = torch::empty({2, heads_ * starts_.back()}, torch::kInt16);
    at::parallel_for(0, problem.sequences, 1, [&](std::int64_t begin, std::int64_t end) {
      for (std::int64_t s = begin; s < end; ++s) {
        if (is_one_task(problem, s)) continue;
        for (std::int64_t head = 0; head < heads_; ++head) {
          pack(problem, k, v, s, head, place(0, s, head), place(1, s, head));
        }
      }
    });
  }
  std::uint16_t* place(std::int64_t part, std::int64_t sequence, std::int64_t head) const {
    const std::int64_t length = start(sequence + 1) - start(sequence);
    return reinterpret_cast<std::uint16_t*>(numbers_.data_ptr<std::int16_t>()) +
           heads_ * (part * starts_.back() + start(sequence)) + head * length;
  }

 private:
  std::int64_t start(std::int64_t sequence) const { return starts_[static_cast<std::size_t>(sequence)]; }

  std::int64_t heads_;
  std::vector<std::int64_t> starts_;  // of one head
  Tensor numbers_;
};

// Numbers of packed keys of the longest sequence that is one task.
std::int64_t longest_own(const RaggedProblem& problem) {
  std::int64_t longest = 0;
  for (std::int64_t s = 0; s < problem.sequences; ++s) {
    if (is_one_task(problem, s)) longest = std::max(longest, problem.keys(s));
  }
  return bf16::packed_bf16_size(longest, problem.channels);
}

// Queries that the kernels take at a time: about equally many each, in whole tiles.
std::int64_t query_block(std::int64_t queries) {
  const std::int64_t even = even_block(queries, bf16::kBf16QueryBlock), tile = bf16::kBf16QueryTile;
  return (even + tile - 1) / tile * tile;
}

struct Bf16Scratch {
  explicit Bf16Scratch(const RaggedProblem& problem)
      : floats(torch::empty({bf16::bf16_scratch_floats(problem.channels)}, torch::kFloat32)),
        numbers(torch::empty({2, longest_own(problem)}, torch::kInt16)) {}
  std::uint16_t* own(std::int64_t part) const {
    return reinterpret_cast<std::uint16_t*>(numbers.data_ptr<std::int16_t>()) + part * numbers.size(1);
  }
  Tensor floats, numbers;
};

// What the next part reads first and writes, to be asked for during the products of this one.
products::RowsAhead rows_after(const RaggedProblem& problem, const HeadTask& part, const HeadTask& next,
                               const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& out) {
  products::RowsAhead ahead;
  if (next.task == nullptr) return ahead;
  const std::int64_t sequence = next.task->sequence, row = problem.q_offsets[sequence] + next.task->first_query;
  const auto add = [&](const Tensor& x, std::int64_t first, std::int64_t count) {
    add_rows(ahead, HeadRows<c10::BFloat16>(x, next.head, first), count, problem.channels);
  };
  if (is_one_task(problem, sequence)) {  // others have packed theirs
    add(k, problem.k_offsets[sequence], problem.keys(sequence));
    add(v, problem.k_offsets[sequence], problem.keys(sequence));
  }
  add(q, row, next.task->queries);
  add(out, row, next.task->queries);
  ahead.spread_over(bf16::bf16_asking_calls(part.task->queries, problem.keys(part.task->sequence), problem.channels));
  return ahead;
}

}  // namespace

void attend_ragged_bf16(const RaggedProblem& problem, const Tensor& q, const Tensor& k, const Tensor& v,
                        const Tensor& out, const Tensor& log_sums) {
  const PackedSequences packed(problem, k, v);
  for_each_head<Bf16Scratch>(
      problem, ragged_tasks(problem, kTaskQueries),
      [&](const HeadTask& part, const HeadTask& next, const Bf16Scratch& scratch) {
        const std::int64_t sequence = part.task->sequence, head = part.head, block = query_block(part.task->queries);
        const bool own = is_one_task(problem, sequence);
        if (own) pack(problem, k, v, sequence, head, scratch.own(0), scratch.own(1));
        const bf16::Bf16Keys keys{own ? scratch.own(0) : packed.place(0, sequence, head),
                                  own ? scratch.own(1) : packed.place(1, sequence, head), problem.keys(sequence),
                                  problem.channels, problem.scale};
        products::RowsAhead ahead = rows_after(problem, part, next, q, k, v, out);
        for (std::int64_t first = 0; first < part.task->queries; first += block) {
          const std::int64_t row = problem.q_offsets[sequence] + part.task->first_query + first;
          bf16::attend_bf16(keys, row_of(q, head, row), q.stride(0), std::min(block, part.task->queries - first),
                            row_of(out, head, row), out.stride(0),
                            log_sums.data_ptr<float>() + head * problem.rows + row, scratch.floats.data_ptr<float>(),
                            ahead);
        }
      });
}

}  // namespace anigen::nn
