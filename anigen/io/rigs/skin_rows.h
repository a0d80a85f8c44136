#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "anigen/asset/skin_weights.h"

namespace anigen::io {

/// Collects weights in any order and makes rows of them that SkinWeights allows, saying what had to be repaired.
class SkinRows {
 public:
  /// @param file for messages
  SkinRows(std::size_t vertices, std::size_t joints, std::string file);

  /// Weights given twice for a vertex and joint add up. Weights below zero are left out and counted.
  /// @param place for messages @throws InputError when vertex or joint is out of range or the weight is not finite
  void add(std::int64_t vertex, std::int64_t joint, float weight, const std::string& place);

  /// Every row divided by its sum. A row without a positive weight becomes weight 1 on `fallback`, as the published
  /// SkinAE trainer does with joint 0 (reference autoencoders.md, 1.3).
  /// @param notes gets a sentence for each kind of repair with how many vertices it touched; sums within 0.01 of 1
  /// are rounding and not told
  SkinWeights finish(std::int32_t fallback, std::vector<std::string>& notes);
  /// Of finish(): vertices that got `fallback`, and the lowest sum of the others' weights (1 when all are above).
  std::size_t unweighted() const { return unweighted_; }
  double lowest_sum() const { return lowest_sum_; }

 private:
  std::string file_;
  std::size_t joints_;
  std::vector<std::vector<Influence>> rows_;
  std::size_t negative_ = 0, unweighted_ = 0;
  double lowest_sum_ = 1.0;
};

}  // namespace anigen::io
