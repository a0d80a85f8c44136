#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace anigen::geometry {

/// Rows of texels that are free or taken, a bit each; rows beyond the last one are free and come into being when
/// something is put there.
class TexelRows {
 public:
  explicit TexelRows(int width);

  int width() const { return width_; }
  int height() const { return static_cast<int>(words_.size() / words_per_row_); }  ///< rows that have been touched

  /// Takes the texels [begin, end) of a row; what lies outside the rows is left out.
  void take(int row, int begin, int end);
  /// The last taken texel in [begin, end) ⊂ [0, width), -1 without one.
  int last_taken(int row, int begin, int end) const;
  /// The first taken texel at or after `from`, width() without one.
  int first_taken(int row, int from) const;
  /// The first free texel at or after `from`, width() without one.
  int first_free(int row, int from) const;
  /// Length of the longest run of free texels.
  int longest_free(int row) const;

 private:
  int first_with(int row, int from, std::uint64_t flip) const;
  const std::uint64_t* row_words(int row) const {
    return words_.data() + static_cast<std::size_t>(row) * words_per_row_;
  }

  int width_;
  std::size_t words_per_row_;
  std::vector<std::uint64_t> words_;
};

}  // namespace anigen::geometry
