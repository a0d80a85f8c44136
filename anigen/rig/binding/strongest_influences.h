#pragma once
#include <cstddef>
#include <vector>

#include "anigen/asset/skin_weights.h"

namespace anigen::rig {

/// The heaviest influences of every row, collected joint by joint, so that [rows, joints] never has to be kept.
/// Which influences are kept does not depend on the order in which they are offered; of equal ones the lower joints.
/// Memory: rows · min(most, joints) · 8 bytes.
class StrongestInfluences {
 public:
  /// @param most influences per row, 0 for all
  StrongestInfluences(std::size_t rows, std::size_t joints, std::size_t most);

  /// One row may be offered to by one thread at a time. @param weight > 0, or nothing happens
  void offer(std::size_t row, std::size_t joint, float weight);
  bool empty(std::size_t row) const { return counts_[row] == 0; }
  /// Every row divided by its sum. @pre no row is empty
  SkinWeights rows() const;

 private:
  std::size_t most_;
  std::vector<std::uint32_t> counts_;  ///< [rows]
  std::vector<Influence> kept_;        ///< [rows, most], heaviest first
};

}  // namespace anigen::rig
