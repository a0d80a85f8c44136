#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace anigen {

struct Influence {
  std::int32_t joint;
  float weight;
};

/// Sparse rows (joint, weight), one row per vertex, each summing to 1, heaviest influence first, no joint twice
/// in a row, no zero weights. Row v is influences[offsets[v]] … influences[offsets[v + 1] - 1].
struct SkinWeights {
  std::vector<std::size_t> offsets{0};  ///< [V + 1]
  std::vector<Influence> influences;

  std::size_t rows() const { return offsets.size() - 1; }
  std::size_t row_size(std::size_t v) const { return offsets[v + 1] - offsets[v]; }
  const Influence* row(std::size_t v) const { return influences.data() + offsets[v]; }
  std::size_t largest_row() const;

  /// Appends a row: merges repeated joints, drops weights ≤ 0 or not finite, divides by the sum, sorts.
  /// @return false when nothing positive was left; the row then is empty and the caller must repair it
  bool append_row(std::vector<Influence> row);
};

/// Keeps the `count` heaviest influences of every row and divides by their sum.
SkinWeights limit_influences(const SkinWeights& weights, std::size_t count);

/// Row-major [V, J]; rows sum to 1.
std::vector<float> to_dense(const SkinWeights& weights, std::size_t joints);
/// @param dense row-major [rows, joints]; entries ≤ threshold are dropped and rows divided by their sum. A row
/// with nothing left becomes weight 1 on joint 0 (what the published SkinAE trainer does).
/// @param unweighted gets the number of such rows, unless null
SkinWeights from_dense(const std::vector<float>& dense, std::size_t rows, std::size_t joints, float threshold = 0.0f,
                       std::size_t* unweighted = nullptr);

}  // namespace anigen
