#include "anigen/nn/ragged.h"

#include <algorithm>
#include <limits>
#include <mutex>
#include <utility>

namespace anigen::nn {
namespace {

// Scores that attention can compute in the time that one item's separate small operations take to start.
constexpr std::int64_t kScoresPerItemStart = 4096;

Tensor index_tensor(const std::vector<std::int64_t>& values) {
  return torch::tensor(values, torch::TensorOptions().dtype(torch::kInt64));
}

}  // namespace

// Only of items of different length.
struct Ragged::Padding {
  std::once_flag made;
  Tensor pad_index, unpad_index, mask;

  void make(const Ragged& ragged) {
    std::vector<std::int64_t> pad, unpad;
    std::vector<float> hidden;
    for (std::int64_t item = 0; item < ragged.items(); ++item) {
      const std::int64_t length = ragged.lengths_[static_cast<std::size_t>(item)];
      for (std::int64_t i = 0; i < ragged.longest_; ++i) {
        const bool real = i < length;
        if (real) unpad.push_back(item * ragged.longest_ + i);
        pad.push_back(real ? ragged.offset(item) + i : 0);
        hidden.push_back(real ? 0.0F : -std::numeric_limits<float>::infinity());
      }
    }
    pad_index = index_tensor(pad);
    unpad_index = index_tensor(unpad);
    mask = torch::tensor(hidden).view({ragged.items(), 1, 1, ragged.longest_});
  }
};

Ragged::Ragged(std::vector<std::int64_t> lengths)
    : lengths_(std::move(lengths)), padding_(std::make_shared<Padding>()) {
  for (const std::int64_t length : lengths_) {
    TORCH_CHECK(length >= 0, "an item of a ragged batch cannot have ", length, " rows");
    offsets_.push_back(rows_);
    rows_ += length;
    longest_ = std::max(longest_, length);
  }
}

const Ragged::Padding& Ragged::padding() const {
  std::call_once(padding_->made, [this] { padding_->make(*this); });
  return *padding_;
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
  const Tensor padded = uniform() ? rows : rows.index_select(0, padding().pad_index.to(rows.device()));
  return padded.view({items(), longest_, rows.size(-1)});
}

Tensor Ragged::unpad(const Tensor& padded) const {
  const Tensor flat = padded.reshape({items() * longest_, padded.size(-1)});
  return uniform() ? flat : flat.index_select(0, padding().unpad_index.to(flat.device()));
}

Tensor Ragged::key_mask(const torch::TensorOptions& options) const {
  return uniform() ? Tensor() : padding().mask.to(options);
}

}  // namespace anigen::nn
