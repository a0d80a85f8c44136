#include "anigen/nn/ragged_attention.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "anigen/nn/attention.h"
#include "anigen/nn/kernels/attention_fp32.h"
#include "anigen/nn/kernels/tiles.h"

namespace anigen::nn {

Ragged::Ragged(std::vector<std::int64_t> lengths) : lengths_(std::move(lengths)) {
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

constexpr std::int64_t kMostPaddedScores = 1LL << 24;  // of all heads and sequences that are padded together

struct RaggedSequence {
  std::int64_t first_query, queries, first_key, keys;
};

Tensor ragged_index(const std::vector<std::int64_t>& rows, const Tensor& like) {
  return torch::tensor(rows, torch::TensorOptions().dtype(torch::kInt64)).to(like.device());
}

// Sequences padded to the longest of them. Padding repeats the last row of the sequence: finite wherever the sequence
// is, and hidden by the mask.
class PaddedSequences {
 public:
  explicit PaddedSequences(std::vector<RaggedSequence> sequences) : sequences_(std::move(sequences)) {
    for (const RaggedSequence& s : sequences_) {
      most_queries_ = std::max(most_queries_, s.queries);
      most_keys_ = std::max(most_keys_, s.keys);
    }
    for (std::size_t i = 0; i < sequences_.size(); ++i) {
      const RaggedSequence& s = sequences_[i];
      for (std::int64_t r = 0; r < most_queries_; ++r) {
        query_rows_.push_back(s.first_query + std::min(r, s.queries - 1));
        if (r < s.queries) kept_.push_back(static_cast<std::int64_t>(i) * most_queries_ + r);
      }
      for (std::int64_t r = 0; r < most_keys_; ++r) {
        key_rows_.push_back(s.first_key + std::min(r, s.keys - 1));
        mask_.push_back(r < s.keys ? 0.0 : -std::numeric_limits<double>::infinity());
      }
    }
  }

  // Rows of the results, sequence after sequence. [Σ queries, H, D]
  Tensor attend(const Tensor& q, const Tensor& k, const Tensor& v) const {
    const auto count = static_cast<std::int64_t>(sequences_.size());
    const Tensor key_rows = ragged_index(key_rows_, k);
    const auto pad = [&](const Tensor& x, const Tensor& rows, std::int64_t length) {
      return x.index_select(0, rows).view({count, length, x.size(1), x.size(2)}).transpose(1, 2);
    };
    const Tensor mask = torch::tensor(mask_, torch::kFloat64).view({count, 1, 1, most_keys_}).to(q.options());
    const Tensor mixed = nn::attend(pad(q, ragged_index(query_rows_, q), most_queries_), pad(k, key_rows, most_keys_),
                                    pad(v, key_rows, most_keys_), mask);
    const Tensor rows = mixed.transpose(1, 2).reshape({count * most_queries_, q.size(1), q.size(2)});
    return rows.index_select(0, ragged_index(kept_, q));
  }

 private:
  std::vector<RaggedSequence> sequences_;
  std::int64_t most_queries_ = 0, most_keys_ = 0;
  std::vector<std::int64_t> query_rows_, key_rows_, kept_;
  std::vector<double> mask_;
};

Tensor attend_alone(const RaggedSequence& s, const Tensor& q, const Tensor& k, const Tensor& v) {
  const auto heads_of = [](const Tensor& x, std::int64_t first, std::int64_t rows) {
    return x.narrow(0, first, rows).transpose(0, 1).unsqueeze(0);
  };
  const Tensor mixed = blocked_attention(heads_of(q, s.first_query, s.queries), heads_of(k, s.first_key, s.keys),
                                         heads_of(v, s.first_key, s.keys));
  return mixed.squeeze(0).transpose(0, 1);
}

// The smallest power of two that is at least n.
std::int64_t length_class(std::int64_t n) {
  std::int64_t power = 1;
  while (power < n) power *= 2;
  return power;
}

// Results of groups of rows, which are put in order in the end.
struct RaggedPieces {
  std::vector<Tensor> results;
  std::vector<std::int64_t> rows;

  void add(const Tensor& result, const std::vector<RaggedSequence>& sequences) {
    results.push_back(result);
    for (const RaggedSequence& s : sequences) {
      for (std::int64_t r = 0; r < s.queries; ++r) rows.push_back(s.first_query + r);
    }
  }
};

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
  const std::int64_t *q_at = q_offsets.data_ptr<std::int64_t>(), *k_at = k_offsets.data_ptr<std::int64_t>();
  const std::int64_t heads = q.size(1);
  std::map<std::pair<std::int64_t, std::int64_t>, std::vector<RaggedSequence>> classes;
  std::vector<RaggedSequence> keyless;
  for (std::int64_t i = 0; i + 1 < q_offsets.size(0); ++i) {
    const RaggedSequence s{q_at[i], q_at[i + 1] - q_at[i], k_at[i], k_at[i + 1] - k_at[i]};
    if (s.queries == 0) continue;
    if (s.keys == 0) {
      keyless.push_back(s);
    } else {
      classes[{length_class(s.queries), length_class(s.keys)}].push_back(s);
    }
  }
  RaggedPieces pieces;
  std::int64_t keyless_rows = 0;
  for (const RaggedSequence& s : keyless) keyless_rows += s.queries;
  pieces.add(torch::zeros({keyless_rows, heads, q.size(2)}, q.options()), keyless);
  for (const auto& [lengths, sequences] : classes) {
    const std::int64_t scores = heads * lengths.first * lengths.second;
    const auto together = static_cast<std::size_t>(std::max<std::int64_t>(1, kMostPaddedScores / scores));
    for (std::size_t first = 0; first < sequences.size(); first += together) {
      const auto begin = sequences.begin() + static_cast<std::ptrdiff_t>(first);
      const auto count = static_cast<std::ptrdiff_t>(std::min(together, sequences.size() - first));
      const std::vector<RaggedSequence> group(begin, begin + count);
      pieces.add(group.size() == 1 ? attend_alone(group[0], q, k, v) : PaddedSequences(group).attend(q, k, v), group);
    }
  }
  std::vector<std::int64_t> places(pieces.rows.size());
  for (std::size_t i = 0; i < places.size(); ++i)
    places[static_cast<std::size_t>(pieces.rows[i])] = static_cast<std::int64_t>(i);
  return torch::cat(pieces.results, 0).index_select(0, ragged_index(places, q));
}

}  // namespace anigen::nn
