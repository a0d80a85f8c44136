#pragma once
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::nn {

/// How the rows of a concatenated batch [ΣN, C] fall into items of different length. Row-wise layers (Linear, norms)
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

  /// Where the items begin, and the number of rows, as ragged_attention() takes them: [items + 1] int64, CPU.
  Tensor row_offsets() const;

  /// Views of the items, [N_i, C] each. The backward pass is one concatenation, unlike slicing row ranges.
  std::vector<Tensor> split(const Tensor& rows) const;

 private:
  std::vector<std::int64_t> lengths_, offsets_;
  std::int64_t rows_ = 0;
};

}  // namespace anigen::nn
