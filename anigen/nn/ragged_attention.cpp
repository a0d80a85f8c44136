#include "anigen/nn/ragged_attention.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <utility>

#include "anigen/nn/attention.h"
#include "anigen/nn/host_tensor.h"
#include "anigen/nn/kernels/attention_fp32.h"
#include "anigen/nn/kernels/tiles.h"

namespace anigen::nn {

struct Ragged::Kept {
  std::mutex mutex;
  HostTensor item_of_rows;
};

Ragged::Ragged(std::vector<std::int64_t> lengths) : lengths_(std::move(lengths)), kept_(std::make_shared<Kept>()) {
  for (const std::int64_t length : lengths_) {
    TORCH_CHECK(length >= 0, "an item of a ragged batch cannot have ", length, " rows");
    offsets_.push_back(rows_);
    rows_ += length;
  }
}

Tensor Ragged::row_offsets() const {
  std::vector<std::int64_t> offsets = offsets_;
  offsets.push_back(rows_);
  return torch::tensor(offsets, torch::TensorOptions().dtype(torch::kInt64));
}

Tensor Ragged::item_of_rows(torch::Device device) const {
  const std::lock_guard<std::mutex> lock(kept_->mutex);
  if (kept_->item_of_rows.defined()) return kept_->item_of_rows.on(device);
  const Tensor items = torch::empty({rows_}, torch::kInt64);
  auto* item = items.data_ptr<std::int64_t>();
  for (std::size_t i = 0; i < lengths_.size(); ++i) {
    item = std::fill_n(item, lengths_[i], static_cast<std::int64_t>(i));
  }
  kept_->item_of_rows = HostTensor(items);
  return kept_->item_of_rows.on(device);
}

std::vector<Tensor> Ragged::split(const Tensor& rows) const { return rows.split_with_sizes(lengths_, 0); }

namespace {

constexpr std::int64_t kLeastScores = 16384;  // of all heads of a task together: some ten microseconds
constexpr std::int64_t kTasksPerThread = 16;  // so that none waits long for the last one

void check_offsets(const char* name, const Tensor& offsets, std::int64_t rows) {
  TORCH_CHECK(offsets.dim() == 1 && offsets.size(0) > 0 && offsets.is_cpu() && offsets.is_contiguous() &&
                  dtype_of(offsets) == torch::kInt64,
              "ragged attention: ", name, " offsets must be contiguous int64 on the CPU, found ", offsets.dtype(), " ",
              offsets.sizes(), " on ", offsets.device());
  const std::int64_t* values = offsets.data_ptr<std::int64_t>();
  const std::int64_t sequences = offsets.size(0) - 1;
  TORCH_CHECK(values[0] == 0 && values[sequences] == rows, "ragged attention: ", name, " offsets go from ", values[0],
              " to ", values[sequences], ", there are ", rows, " rows");
  for (std::int64_t s = 0; s < sequences; ++s) {
    TORCH_CHECK(values[s] <= values[s + 1], "ragged attention: ", name, " offsets descend from ", values[s], " to ",
                values[s + 1], " at sequence ", s);
  }
}

// Scores of all heads and sequences that are padded together. A fused kernel never holds them, and few large groups
// cost the fewest calls of it.
constexpr std::int64_t kMostPaddedScores = 1LL << 24, kMostFusedScores = 1LL << 36;

struct RaggedSequence {
  std::int64_t first_query, queries, first_key, keys;
};

Tensor ragged_index(const std::vector<std::int64_t>& rows, torch::Device device) {
  return to_device(torch::tensor(rows, torch::TensorOptions().dtype(torch::kInt64)), device);
}

// Sequences of about the same length, padded to the longest of them. Padding repeats the last row of the sequence:
// finite wherever the sequence is, and hidden by the mask.
class PaddedSequences {
 public:
  PaddedSequences(std::vector<RaggedSequence> sequences, torch::Device device) : sequences_(std::move(sequences)) {
    for (const RaggedSequence& s : sequences_) {
      most_queries_ = std::max(most_queries_, s.queries);
      most_keys_ = std::max(most_keys_, s.keys);
    }
    if (sequences_.size() == 1) return;
    std::vector<std::int64_t> query_rows, key_rows, kept;
    std::vector<float> mask;
    for (std::size_t i = 0; i < sequences_.size(); ++i) {
      const RaggedSequence& s = sequences_[i];
      for (std::int64_t r = 0; r < most_queries_; ++r) {
        query_rows.push_back(s.first_query + std::min(r, s.queries - 1));
        if (r < s.queries) kept.push_back(static_cast<std::int64_t>(i) * most_queries_ + r);
      }
      for (std::int64_t r = 0; r < most_keys_; ++r) {
        key_rows.push_back(s.first_key + std::min(r, s.keys - 1));
        mask.push_back(r < s.keys ? 0.0F : -std::numeric_limits<float>::infinity());
      }
    }
    query_rows_ = ragged_index(query_rows, device);
    key_rows_ = ragged_index(key_rows, device);
    kept_ = ragged_index(kept, device);
    mask_ = to_device(torch::tensor(mask, torch::kFloat32), device).view({count(), 1, 1, most_keys_});
  }

  const std::vector<RaggedSequence>& sequences() const { return sequences_; }

  // Rows of the results, sequence after sequence. [Σ queries, H, D]
  Tensor attend(const Tensor& q, const Tensor& k, const Tensor& v) const {
    if (sequences_.size() == 1) return attend_alone(q, k, v);
    const auto pad = [&](const Tensor& x, const Tensor& rows, std::int64_t length) {
      return x.index_select(0, rows).view({count(), length, x.size(1), x.size(2)}).transpose(1, 2);
    };
    const Tensor queries = pad(q, query_rows_, most_queries_), keys = pad(k, key_rows_, most_keys_),
                 values = pad(v, key_rows_, most_keys_), mask = mask_.to(dtype_of(q));
    const Tensor mixed = kHasFusedAttention && q.is_cuda() ? fused_attention(queries, keys, values, mask)
                                                           : nn::attend(queries, keys, values, mask);
    const Tensor rows = mixed.transpose(1, 2).reshape({count() * most_queries_, q.size(1), q.size(2)});
    return rows.index_select(0, kept_);
  }

 private:
  std::int64_t count() const { return static_cast<std::int64_t>(sequences_.size()); }

  Tensor attend_alone(const Tensor& q, const Tensor& k, const Tensor& v) const {
    const RaggedSequence& s = sequences_.front();
    const auto heads_of = [](const Tensor& x, std::int64_t first, std::int64_t rows) {
      return x.narrow(0, first, rows).transpose(0, 1).unsqueeze(0);
    };
    const Tensor mixed = blocked_attention(heads_of(q, s.first_query, s.queries), heads_of(k, s.first_key, s.keys),
                                           heads_of(v, s.first_key, s.keys));
    return mixed.squeeze(0).transpose(0, 1);
  }

  std::vector<RaggedSequence> sequences_;
  std::int64_t most_queries_ = 0, most_keys_ = 0;
  Tensor query_rows_, key_rows_, kept_, mask_;  // of two sequences or more
};

// The smallest power of two that is at least n.
std::int64_t length_class(std::int64_t n) {
  std::int64_t power = 1;
  while (power < n) power *= 2;
  return power;
}

// Groups of sequences that are computed together, with the indices of their rows on a device.
struct RaggedPlan {
  std::vector<std::int64_t> q_offsets, k_offsets;
  std::int64_t heads = 0, keyless_rows = 0;
  torch::Device device = torch::kCPU;
  std::vector<PaddedSequences> groups;
  Tensor places;  // of all rows, in the rows of sequences without keys, then of the groups

  RaggedPlan(const Tensor& q, const Tensor& q_starts, const Tensor& k_starts)
      : q_offsets(values_of(q_starts)), k_offsets(values_of(k_starts)), heads(q.size(1)), device(q.device()) {
    std::map<std::pair<std::int64_t, std::int64_t>, std::vector<RaggedSequence>> classes;
    std::vector<RaggedSequence> keyless;
    for (std::size_t i = 0; i + 1 < q_offsets.size(); ++i) {
      const RaggedSequence s{q_offsets[i], q_offsets[i + 1] - q_offsets[i], k_offsets[i],
                             k_offsets[i + 1] - k_offsets[i]};
      if (s.queries == 0) continue;
      if (s.keys == 0) {
        keyless.push_back(s);
        keyless_rows += s.queries;
      } else {
        classes[{length_class(s.queries), length_class(s.keys)}].push_back(s);
      }
    }
    std::vector<std::int64_t> in_order(static_cast<std::size_t>(q.size(0)));
    std::int64_t next = 0;
    const auto place = [&](const std::vector<RaggedSequence>& sequences) {
      for (const RaggedSequence& s : sequences) {
        for (std::int64_t r = 0; r < s.queries; ++r) in_order[static_cast<std::size_t>(s.first_query + r)] = next++;
      }
    };
    place(keyless);
    const std::int64_t most = kHasFusedAttention && q.is_cuda() ? kMostFusedScores : kMostPaddedScores;
    for (const auto& [lengths, sequences] : classes) {
      const std::int64_t scores = heads * lengths.first * lengths.second;
      const auto together = static_cast<std::size_t>(std::max<std::int64_t>(1, most / scores));
      for (std::size_t first = 0; first < sequences.size(); first += together) {
        const auto begin = sequences.begin() + static_cast<std::ptrdiff_t>(first);
        const auto count = static_cast<std::ptrdiff_t>(std::min(together, sequences.size() - first));
        groups.emplace_back(std::vector<RaggedSequence>(begin, begin + count), device);
        place(groups.back().sequences());
      }
    }
    places = ragged_index(in_order, device);
  }

  bool fits(const Tensor& q, const Tensor& q_starts, const Tensor& k_starts) const {
    const auto same = [](const std::vector<std::int64_t>& known, const Tensor& given) {
      const std::int64_t* const first = given.data_ptr<std::int64_t>();
      return static_cast<std::int64_t>(known.size()) == given.numel() && std::equal(known.begin(), known.end(), first);
    };
    return device == q.device() && heads == q.size(1) && same(q_offsets, q_starts) && same(k_offsets, k_starts);
  }

 private:
  static std::vector<std::int64_t> values_of(const Tensor& offsets) {
    const std::int64_t* const first = offsets.data_ptr<std::int64_t>();
    return {first, first + offsets.numel()};
  }
};

// The plan of these sequences, from the last few of this thread where it is among them: all layers of a network
// attend within the same few divisions of rows.
std::shared_ptr<const RaggedPlan> ragged_plan(const Tensor& q, const Tensor& q_offsets, const Tensor& k_offsets) {
  constexpr std::size_t kKeptPlans = 12;
  thread_local std::deque<std::shared_ptr<const RaggedPlan>> recent;
  const auto found =
      std::find_if(recent.begin(), recent.end(), [&](const auto& plan) { return plan->fits(q, q_offsets, k_offsets); });
  std::shared_ptr<const RaggedPlan> plan =
      found != recent.end() ? *found : std::make_shared<const RaggedPlan>(q, q_offsets, k_offsets);
  if (found != recent.end()) recent.erase(found);
  recent.push_front(plan);
  if (recent.size() > kKeptPlans) recent.pop_back();
  return plan;
}

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

bool RaggedProblem::is_paired() const {
  for (std::int64_t s = 0; s < sequences; ++s) {
    if ((queries(s) == 0) != (keys(s) == 0)) return false;
  }
  return true;
}

double RaggedProblem::product_operations() const {
  double pairs = 0.0;
  for (std::int64_t s = 0; s < sequences; ++s) pairs += static_cast<double>(queries(s) * keys(s));
  return 2.0 * pairs * static_cast<double>(heads * channels);
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

Tensor ragged_attention(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& q_offsets,
                        const Tensor& k_offsets) {
  TORCH_CHECK(q.dim() == 3 && k.dim() == 3 && v.sizes() == k.sizes() && q.size(1) == k.size(1) &&
                  q.size(2) == k.size(2) && q.size(1) > 0 && q.size(2) > 0,
              "ragged attention of queries ", q.sizes(), " to keys ", k.sizes(), " and values ", v.sizes());
  TORCH_CHECK(dtype_of(q) == dtype_of(k) && dtype_of(q) == dtype_of(v) && q.is_floating_point(),
              "ragged attention of queries of type ", q.dtype(), " to keys of type ", k.dtype(), " and values of type ",
              v.dtype());
  check_offsets("query", q_offsets, q.size(0));
  check_offsets("key", k_offsets, k.size(0));
  TORCH_CHECK(q_offsets.size(0) == k_offsets.size(0), "ragged attention of ", q_offsets.size(0) - 1,
              " sequences of queries to ", k_offsets.size(0) - 1, " of keys");
  if (q.is_cpu() && dtype_of(q) != torch::kFloat64) return cpu_ragged_attention(q, k, v, q_offsets, k_offsets);
  return tensor_ragged_attention(q, k, v, q_offsets, k_offsets);
}

Tensor tensor_ragged_attention(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& q_offsets,
                               const Tensor& k_offsets) {
  const std::shared_ptr<const RaggedPlan> plan = ragged_plan(q, q_offsets, k_offsets);
  std::vector<Tensor> results{torch::zeros({plan->keyless_rows, q.size(1), q.size(2)}, q.options())};
  for (const PaddedSequences& group : plan->groups) results.push_back(group.attend(q, k, v));
  return torch::cat(results, 0).index_select(0, plan->places);
}

}  // namespace anigen::nn
