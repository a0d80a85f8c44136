#include "anigen/nn/ragged_tasks.h"

#include <algorithm>
#include <cmath>

#include "anigen/nn/small_products.h"

namespace anigen::nn {
namespace {

constexpr std::int64_t kLeastScores = 16384;  // of all heads of a task together: some ten microseconds
constexpr std::int64_t kTasksPerThread = 16;  // so that none waits long for the last one

}  // namespace

RaggedProblem::RaggedProblem(const Tensor& q, const Tensor& k, const Tensor& q_offset_rows, const Tensor& k_offset_rows)
    : q_offsets(q_offset_rows.data_ptr<std::int64_t>()),
      k_offsets(k_offset_rows.data_ptr<std::int64_t>()),
      sequences(q_offset_rows.size(0) - 1),
      rows(q.size(0)),
      heads(k.size(1)),
      channels(k.size(2)),
      width(products::padded(k.size(2))),
      scale(static_cast<float>(1.0 / std::sqrt(static_cast<double>(k.size(2))))) {
  for (std::int64_t s = 0; s < sequences; ++s) {
    if (queries(s) == 0 || keys(s) == 0) continue;
    longest_queries = std::max(longest_queries, queries(s));
    longest_keys = std::max(longest_keys, keys(s));
  }
}

std::int64_t even_block(std::int64_t total, std::int64_t most) {
  const std::int64_t blocks = std::max<std::int64_t>(1, (total + most - 1) / most);
  return (total + blocks - 1) / blocks;
}

std::vector<RaggedTask> ragged_tasks(const RaggedProblem& problem, std::int64_t most_queries) {
  std::int64_t scores = 0;
  for (std::int64_t s = 0; s < problem.sequences; ++s) scores += problem.heads * problem.queries(s) * problem.keys(s);
  const std::int64_t enough = std::max(kLeastScores, scores / (kTasksPerThread * at::get_num_threads()));
  std::vector<RaggedTask> tasks;
  for (std::int64_t s = 0; s < problem.sequences; ++s) {
    const std::int64_t queries = problem.queries(s), keys = problem.keys(s);
    if (queries == 0 || keys == 0) continue;
    const std::int64_t block = even_block(queries, most_queries);
    const std::int64_t heads = std::clamp<std::int64_t>(enough / (block * keys), 1, problem.heads);
    for (std::int64_t head = 0; head < problem.heads; head += heads) {
      for (std::int64_t first = 0; first < queries; first += block) {
        tasks.push_back({s, head, std::min(heads, problem.heads - head), first, std::min(block, queries - first)});
      }
    }
  }
  const auto work = [&](const RaggedTask& task) { return task.heads * task.queries * problem.keys(task.sequence); };
  std::stable_sort(tasks.begin(), tasks.end(),
                   [&](const RaggedTask& a, const RaggedTask& b) { return work(a) > work(b); });
  return tasks;
}

}  // namespace anigen::nn
