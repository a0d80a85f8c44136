#include "anigen/geometry/uv_atlas/texel_rows.h"

#include <algorithm>

#include "anigen/core/numeric.h"

namespace anigen::geometry {
namespace {

constexpr int kWordBits = 64;
constexpr std::uint64_t kAllBits = ~std::uint64_t{0};

/// The bits of a word that are texels of [begin, end).
std::uint64_t bits_of_word(int word, int begin, int end) {
  const int from = std::max(begin - word * kWordBits, 0), to = std::min(end - word * kWordBits, kWordBits);
  if (from >= to) return 0;
  return (kAllBits << from) & (kAllBits >> (kWordBits - to));
}

}  // namespace

TexelRows::TexelRows(int width) : width_(width), words_per_row_((at(width) + kWordBits - 1) / kWordBits) {}

void TexelRows::take(int row, int begin, int end) {
  begin = std::max(begin, 0);
  end = std::min(end, width_);
  if (row < 0 || begin >= end) return;
  if (row >= height()) words_.resize((at(row) + 1) * words_per_row_, 0);
  std::uint64_t* words = words_.data() + at(row) * words_per_row_;
  for (int w = begin / kWordBits; w <= (end - 1) / kWordBits; ++w) words[w] |= bits_of_word(w, begin, end);
}

int TexelRows::last_taken(int row, int begin, int end) const {
  if (row >= height() || begin >= end) return -1;
  const std::uint64_t* words = row_words(row);
  for (int w = (end - 1) / kWordBits; w >= begin / kWordBits; --w) {
    const std::uint64_t bits = words[w] & bits_of_word(w, begin, end);
    if (bits != 0) return w * kWordBits + kWordBits - 1 - __builtin_clzll(bits);
  }
  return -1;
}

/// The first texel at or after `from` whose bit, after flipping those in `flip`, is set.
int TexelRows::first_with(int row, int from, std::uint64_t flip) const {
  const std::uint64_t* words = row_words(row);
  for (int w = from / kWordBits; w * kWordBits < width_; ++w) {
    const std::uint64_t bits = (words[w] ^ flip) & bits_of_word(w, from, width_);
    if (bits != 0) return w * kWordBits + __builtin_ctzll(bits);
  }
  return width_;
}

int TexelRows::first_taken(int row, int from) const {
  return row >= height() || from >= width_ ? width_ : first_with(row, from, 0);
}

int TexelRows::first_free(int row, int from) const {
  return row >= height() || from >= width_ ? std::min(from, width_) : first_with(row, from, kAllBits);
}

int TexelRows::longest_free(int row) const {
  int longest = 0;
  for (int begin = first_free(row, 0), end = 0; begin < width_; begin = first_free(row, end)) {
    end = first_taken(row, begin);
    longest = std::max(longest, end - begin);
  }
  return longest;
}

}  // namespace anigen::geometry
