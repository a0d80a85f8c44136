#include "anigen/nn/ragged.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace anigen::nn {
namespace {

// Scores that attention can compute in the time that one item's separate small operations take to start.
constexpr std::int64_t kScoresPerItemStart = 4096;

Tensor index_tensor(const std::vector<std::int64_t>& values) {
  return torch::tensor(values, torch::TensorOptions().dtype(torch::kInt64));
}

}  // namespace

Ragged::Ragged(std::vector<std::int64_t> lengths) : lengths_(std::move(lengths)) {
  for (const std::int64_t length : lengths_) {
    TORCH_CHECK(length >= 0, "an item of a ragged batch cannot have ", length, " rows");
    offsets_.push_back(rows_);
    rows_ += length;
    longest_ = std::max(longest_, length);
  }
  if (uniform()) return;
  std::vector<std::int64_t> pad_index, unpad_index;
  std::vector<float> padding;
  for (std::size_t item = 0; item < lengths_.size(); ++item) {
    for (std::int64_t i = 0; i < longest_; ++i) {
      const bool real = i < lengths_[item];
      if (real) unpad_index.push_back(static_cast<std::int64_t>(item) * longest_ + i);
      pad_index.push_back(real ? offsets_[item] + i : 0);
      padding.push_back(real ? 0.0F : -std::numeric_limits<float>::infinity());
    }
  }
  pad_index_ = index_tensor(pad_index);
  unpad_index_ = index_tensor(unpad_index);
  padding_ = torch::tensor(padding).view({items(), 1, 1, longest_});
}

bool Ragged::padding_pays() const {
  std::int64_t needed = 0;
  for (const std::int64_t length : lengths_) {
    if (length == 0) return false;  // a query of an empty item would see only padding
    needed += length * length;
  }
  return items() * longest_ * longest_ <= needed + items() * kScoresPerItemStart;
}

std::vector<Tensor> Ragged::split(const Tensor& rows) const { return rows.split_with_sizes(lengths_, 0); }

Tensor Ragged::pad(const Tensor& rows) const {
  const Tensor padded = uniform() ? rows : rows.index_select(0, pad_index_.to(rows.device()));
  return padded.view({items(), longest_, rows.size(-1)});
}

Tensor Ragged::unpad(const Tensor& padded) const {
  const Tensor flat = padded.reshape({items() * longest_, padded.size(-1)});
  return uniform() ? flat : flat.index_select(0, unpad_index_.to(flat.device()));
}

Tensor Ragged::key_mask(const torch::TensorOptions& options) const {
  return uniform() ? Tensor() : padding_.to(options);
}

}  // namespace anigen::nn
