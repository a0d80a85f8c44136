#include "anigen/nn/ragged.h"

#include <utility>

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

}  // namespace anigen::nn
