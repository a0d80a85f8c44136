#include "anigen/sparse/cpu_ragged_bf16.h"

#include "anigen/nn/bf16_attention_kernels.h"
#include "anigen/nn/bf16_bits.h"

namespace anigen::sparse {
namespace {

namespace bf16 = nn::kernels;

std::uint16_t* row_of(const Tensor& x, std::int64_t head, std::int64_t row) {
  return nn::bf16_bits(x) + head * x.stride(1) + row * x.stride(0);
}

// Keys and values of every sequence and head as the kernels read them.
class PackedSequences {
 public:
  PackedSequences(const RaggedProblem& problem, const Tensor& k, const Tensor& v)
      : heads_(problem.heads), starts_(static_cast<std::size_t>(problem.sequences) + 1, 0) {
    for (std::int64_t s = 0; s < problem.sequences; ++s) {
      starts_[static_cast<std::size_t>(s) + 1] = start(s) + bf16::packed_bf16_size(problem.keys(s), problem.channels);
    }
    numbers_ = torch::empty({2, heads_ * starts_.back()}, torch::kInt16);
    at::parallel_for(0, problem.sequences, 1, [&](std::int64_t begin, std::int64_t end) {
      for (std::int64_t s = begin; s < end; ++s) {
        const std::int64_t first = problem.k_offsets[s], count = problem.keys(s), channels = problem.channels;
        for (std::int64_t head = 0; head < heads_; ++head) {
          bf16::pack_bf16_keys(row_of(k, head, first), k.stride(0), count, channels, place(0, s, head));
          bf16::pack_bf16_values(row_of(v, head, first), v.stride(0), count, channels, place(1, s, head));
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

struct Scratch {
  explicit Scratch(const RaggedProblem& problem)
      : floats(torch::empty({bf16::bf16_scratch_floats(problem.channels)}, torch::kFloat32)) {}
  Tensor floats;
};

}  // namespace

void attend_ragged_bf16(const RaggedProblem& problem, const Tensor& q, const Tensor& k, const Tensor& v,
                        const Tensor& out, const Tensor& log_sums) {
  const PackedSequences packed(problem, k, v);
  for_each_task<Scratch>(
      problem, ragged_tasks(problem, bf16::kBf16QueryBlock), [&](const RaggedTask& task, const Scratch& scratch) {
        const std::int64_t row = problem.q_offsets[task.sequence] + task.first_query;
        for (std::int64_t head = task.first_head; head < task.first_head + task.heads; ++head) {
          const bf16::Bf16Keys keys{packed.place(0, task.sequence, head), packed.place(1, task.sequence, head),
                                    problem.keys(task.sequence), problem.channels, problem.scale};
          bf16::attend_bf16(keys, row_of(q, head, row), q.stride(0), task.queries, row_of(out, head, row),
                            out.stride(0), log_sums.data_ptr<float>() + head * problem.rows + row,
                            scratch.floats.data_ptr<float>());
        }
      });
}

}  // namespace anigen::sparse
