#pragma once
#include <algorithm>
#include <cstdint>

#include "anigen/nn/vector_exp.h"

namespace anigen::nn::products {

/// Rows in memory that the thread reads or writes soon, asked for a few at a time while it computes: rows of one head
/// lie a page apart, where no processor guesses the next one. Only a hint: the rows are neither read nor changed.
class RowsAhead {
 public:
  /// `count` rows of `bytes`, `stride` bytes apart. Up to kRanges of them; more are left out.
  void add(const void* first, std::int64_t count, std::int64_t stride, std::int64_t bytes) {
    if (ranges_ == kRanges || count == 0) return;
    ranges_of_[ranges_++] = {static_cast<const char*>(first), stride, bytes, count};
    left_ += count;
  }

  /// Spreads all rows over so many calls of ask().
  void spread_over(std::int64_t calls) { pace_ = (left_ + calls - 1) / std::max<std::int64_t>(calls, 1); }

  ANIGEN_INLINE void ask() {
    for (std::int64_t i = std::min(pace_, left_); i > 0; --i, --left_) {
      Range& range = ranges_of_[current_];
      for (std::int64_t b = 0; b < range.bytes; b += kCacheLine) __builtin_prefetch(range.row + b);
      range.row += range.stride;
      if (--range.count == 0) ++current_;
    }
  }

  /// Rows not asked for yet.
  std::int64_t left() const { return left_; }

 private:
  struct Range {
    const char* row;
    std::int64_t stride, bytes, count;
  };
  static constexpr int kRanges = 8;
  static constexpr std::int64_t kCacheLine = 64;

  Range ranges_of_[kRanges] = {};
  int ranges_ = 0, current_ = 0;
  std::int64_t left_ = 0, pace_ = 0;
};

}  // namespace anigen::nn::products
