#pragma once
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::models::anymate {

using torch::Tensor;

/// Which keys of each item of a batch count. The released models set the scores of the others to -1e8, whose softmax is
/// zero in fp32 unless an item has no key that counts, which then attends to all of its keys alike.
class KeyMask {
 public:
  KeyMask() = default;  ///< all keys count
  /// @param mask [B, S], numbers or bool: not zero where the key counts @throws InputError for another shape
  explicit KeyMask(const Tensor& mask);

  /// Whether nothing is masked.
  bool all() const { return rows_.empty(); }
  std::int64_t items() const { return static_cast<std::int64_t>(rows_.size()); }
  std::int64_t keys() const { return keys_; }
  /// Of an item: int64 indices of the keys that count; undefined when all do.
  const Tensor& rows(std::int64_t item) const { return rows_[static_cast<std::size_t>(item)]; }

 private:
  std::vector<Tensor> rows_;
  std::int64_t keys_ = 0;
};

/// softmax(q kᵀ / √d) v over the keys that count. Scores are never held whole (nn::blocked_attention), and keys that do
/// not count are left out before, which is the same and costs nothing.
/// @param q [B, H, N, d] @param k, v [B, H, S, d] @return [B, H, N, d]
/// @throws InputError when the mask has another number of items or keys
Tensor masked_attention(const Tensor& q, const Tensor& k, const Tensor& v, const KeyMask& mask = {});

}  // namespace anigen::models::anymate
