#pragma once
#include <ATen/Parallel.h>
#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::nn {

/// Division of the rows of a concatenated batch [ΣN, C] into items of different length. Row-wise layers (Linear, norms)
/// then run as one product over all rows, and only attention needs to know where an item begins and ends.
class Ragged {
 public:
  /// @param lengths rows of each item, each at least 0
  explicit Ragged(std::vector<std::int64_t> lengths);

  const std::vector<std::int64_t>& lengths() const { return lengths_; }
  std::int64_t items() const { return static_cast<std::int64_t>(lengths_.size()); }
  std::int64_t rows() const { return rows_; }
  /// Row where item i begins.
  std::int64_t offset(std::int64_t item) const { return offsets_[static_cast<std::size_t>(item)]; }

  /// First row of every item, and the number of rows, as ragged_attention() takes them: [items + 1] int64, CPU.
  Tensor row_offsets() const;

  /// Item of every row, [rows] int64, kept on that device after the first call; copies share it. Thread-safe.
  Tensor item_of_rows(torch::Device device) const;

  /// Views of the items, [N_i, C] each. The backward pass is one concatenation, unlike slicing row ranges.
  std::vector<Tensor> split(const Tensor& rows) const;

 private:
  struct Kept;
  std::vector<std::int64_t> lengths_, offsets_;
  std::int64_t rows_ = 0;
  std::shared_ptr<Kept> kept_;
};

/// Sizes of a ragged attention, and where its sequences lie. Keeps the offsets' storage by reference.
struct RaggedProblem {
  /// @param q, k [rows, H, D] @param q_offsets, k_offsets [S + 1] int64, CPU
  RaggedProblem(const Tensor& q, const Tensor& k, const Tensor& q_offsets, const Tensor& k_offsets);

  std::int64_t queries(std::int64_t sequence) const { return q_offsets[sequence + 1] - q_offsets[sequence]; }
  std::int64_t keys(std::int64_t sequence) const { return k_offsets[sequence + 1] - k_offsets[sequence]; }

  /// True when no sequence has queries without keys, or keys without queries.
  bool is_paired() const;
  /// Operations of q kᵀ, or of any other of the products of this size.
  double product_operations() const;

  const std::int64_t *q_offsets, *k_offsets;
  std::int64_t sequences, rows, heads, channels;
  std::int64_t width;                                  ///< channels rounded up for products::multiply
  std::int64_t longest_queries = 0, longest_keys = 0;  ///< of sequences that have both
  float scale;                                         ///< 1 / √D
  bool rounds_weights = false;  ///< to bf16, as factors of emulated products (nn/kernels/mixed_products.h)
};

/// Unit of work of a thread: some heads of some queries of a sequence that has keys.
struct RaggedTask {
  std::int64_t sequence, first_head, heads, first_query, queries;
};

/// All tasks, the most work first, so that no thread is left with a long one at the end. A task has as many heads as
/// leave enough tasks for all threads: heads lie side by side in memory, and a thread that takes them one after the
/// other finds their pages open. @param most_queries of a task; blocks of a sequence are about equally long
std::vector<RaggedTask> ragged_tasks(const RaggedProblem& problem, std::int64_t most_queries);

/// Number of `total` rows in a block: as few blocks as possible of at most `most`, about equally long.
std::int64_t even_block(std::int64_t total, std::int64_t most);

/// One head of a task.
struct HeadTask {
  const RaggedTask* task = nullptr;
  std::int64_t head = 0;
};

/// Calls body(part, next, scratch) for every head of every task, with one Scratch(problem) per thread; `next` is what
/// the thread does afterwards, its task null when that is not known yet. Which thread does what depends on timing: a
/// part must write to places of its own.
template <typename Scratch, typename Body>
void for_each_head(const RaggedProblem& problem, const std::vector<RaggedTask>& tasks, const Body& body) {
  const auto count = static_cast<std::int64_t>(tasks.size());
  const std::int64_t threads = count < at::get_num_threads() ? count : at::get_num_threads();
  std::atomic<std::int64_t> taken{threads};
  const auto take = [&]() -> const RaggedTask* {
    const std::int64_t i = taken++;
    return i < count ? &tasks[static_cast<std::size_t>(i)] : nullptr;
  };
  const auto work = [&](const RaggedTask* task, const Scratch& scratch) {
    while (task != nullptr) {
      const std::int64_t end = task->first_head + task->heads;
      const RaggedTask* following = nullptr;
      for (std::int64_t head = task->first_head; head < end; ++head) {
        HeadTask next{task, head + 1};
        if (next.head == end) {
          // Ahead of its turn only while every thread may have another.
          if (taken.load() + threads <= count) following = take();
          next = {following, following == nullptr ? 0 : following->first_head};
        }
        body(HeadTask{task, head}, next, scratch);
      }
      task = following != nullptr ? following : take();
    }
  };
  at::parallel_for(0, threads, 1, [&](std::int64_t begin, std::int64_t end) {
    const torch::NoGradGuard no_grad;  // a setting of the thread
    const Scratch scratch(problem);
    for (std::int64_t i = begin; i < end; ++i) work(&tasks[static_cast<std::size_t>(i)], scratch);
  });
}

/// softmax(q kᵀ / √D) v within each of S sequences of different length: rows offsets[s] … offsets[s+1] of q see rows
/// k_offsets[s] … k_offsets[s+1] of k and v. A query without keys gives exactly 0, and passes no gradient. No padding;
/// scores of a sequence are never held whole when it is long (see nn/attention.h). On a CPU sums and softmax of
/// fp32 and 16-bit values are fp32, each sequence and head is computed by one thread at a time, and the result, forward
/// and backward, is the same for any number of threads; there it can be differentiated once, a second time is an error.
/// A query with scores that are not finite becomes NaN. On a GPU, and in fp64, sequences of similar length are padded
/// and computed together by tensor operations.
/// @param q [N, H, D] @param k, v [M, H, D], dtype of q @param q_offsets, k_offsets [S + 1] int64, CPU, ascending from
/// 0 to N and M @return [N, H, D], dtype of q
Tensor ragged_attention(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& q_offsets,
                        const Tensor& k_offsets);

/// ragged_attention by tensor operations, for a GPU and for fp64: sequences are sorted by length, and as many of about
/// the same length as bounded memory for their scores allows are padded and computed together; one that is too long for
/// that goes through blocked_attention. Arguments as ragged_attention, which checks them.
Tensor tensor_ragged_attention(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& q_offsets,
                               const Tensor& k_offsets);

}  // namespace anigen::nn
