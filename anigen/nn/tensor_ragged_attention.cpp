#include "anigen/nn/tensor_ragged_attention.h"

#include <algorithm>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "anigen/nn/attention.h"
#include "anigen/nn/blocked_attention.h"

namespace anigen::nn {
namespace {

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
  for (std::size_t i = 0; i < places.size(); ++i) {
    places[static_cast<std::size_t>(pieces.rows[i])] = static_cast<std::int64_t>(i);
  }
  return torch::cat(pieces.results, 0).index_select(0, ragged_index(places, q));
}

}  // namespace anigen::nn
