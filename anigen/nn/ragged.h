#pragma once
#include <memory>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::nn {

/// How the rows of a concatenated batch [ΣN, C] fall into items of different length. Row-wise layers (Linear, norms)
/// then run as one product over all rows, and only attention needs to know where an item begins and ends. Tables for
/// padding are made when first needed, and shared by copies. Thread-safe.
class Ragged {
 public:
  /// @param lengths rows of each item, each at least 0
  explicit Ragged(std::vector<std::int64_t> lengths);

  const std::vector<std::int64_t>& lengths() const { return lengths_; }
  std::int64_t items() const { return static_cast<std::int64_t>(lengths_.size()); }
  std::int64_t rows() const { return rows_; }
  std::int64_t longest() const { return longest_; }
  bool uniform() const { return rows_ == longest_ * items(); }  ///< all items have the same length
  /// Row where item i begins.
  std::int64_t offset(std::int64_t item) const { return offsets_[static_cast<std::size_t>(item)]; }

  /// Whether padding every item to the longest costs less than treating the items one by one: the extra products
  /// of attention against the start-up cost of some ten small operations per item.
  bool padding_pays() const;

  /// Views of the items, [N_i, C] each. The backward pass is one concatenation, unlike slicing row ranges.
  std::vector<Tensor> split(const Tensor& rows) const;
  /// [ΣN, C] → [B, longest, C]. Padding repeats an existing row: finite, and masked out by key_mask.
  Tensor pad(const Tensor& rows) const;
  /// Inverse of pad: [B, longest, C] → [ΣN, C].
  Tensor unpad(const Tensor& padded) const;
  /// [B, 1, 1, longest]: 0 for rows of the item, -inf for padding; undefined when there is no padding.
  Tensor key_mask(const torch::TensorOptions& options) const;

 private:
  std::vector<std::int64_t> lengths_, offsets_;
  std::int64_t rows_ = 0, longest_ = 0;
  struct Padding;
  const Padding& padding() const;
  std::shared_ptr<Padding> padding_;
};

}  // namespace anigen::nn
