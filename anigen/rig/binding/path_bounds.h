#pragma once
#include <cstddef>
#include <utility>
#include <vector>

#include "anigen/rig/binding/solid_voxels.h"

namespace anigen::rig {

/// How far away a joint may be, at each place of a solid, and still be among the nearest few. What is farther needs no
/// paths there, nor through there: each of those few is nearer also at the end of every path that goes on. So with
/// bounds each joint's paths stay around the joint, and the nearest few are the same, bit for bit, in whichever order
/// joints come. Kept per block of 4³ cells, for the farthest cell of each.
class PathBounds {
 public:
  /// @param most how many nearest joints are wanted, 0 for all: nothing is bounded then
  PathBounds(const SolidVoxels& solid, std::size_t most);

  /// Longest path to a cell that may matter, in cells; infinite while fewer than `most` joints reach its whole block.
  float at_cell(std::size_t cell) const {
    return most_ == 0 ? kUnbounded : nearest_[block_of(cell) * most_ + most_ - 1];
  }
  /// Takes note of finished paths. Runs on all threads.
  /// @param joints [cells] distances as VoxelPaths gives them, and how much longer each path is
  void add(const std::vector<std::pair<const std::vector<float>*, double>>& joints);

 private:
  static constexpr float kUnbounded = 3.4e38F;
  std::size_t block_of(std::size_t cell) const { return block_of_row_[cell / row_] + (cell % row_) / kSide; }
  static constexpr std::size_t kSide = 4;

  const SolidVoxels* solid_;
  std::size_t most_, row_;                 ///< cells along z
  std::vector<std::size_t> block_of_row_;  ///< [cells / row_] first block of each row along z
  std::size_t blocks_along_[3];
  std::vector<float> nearest_;  ///< [blocks, most] ascending
};

}  // namespace anigen::rig
