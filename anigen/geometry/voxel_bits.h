#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/geometry/voxel_grid.h"

namespace anigen::geometry {

/// A set of voxels as one bit each: R² rows along z of whole 64-bit words. Inserting may happen from many threads at
/// once, and the set does not depend on their order; everything else may not run at the same time as inserting.
class VoxelBits {
 public:
  /// The empty set. @pre 1 ≤ resolution ≤ kMaxVoxelResolution
  explicit VoxelBits(int resolution);

  int resolution() const { return resolution_; }
  std::size_t words() const { return words_; }  ///< per row
  std::uint64_t* row(int x, int y) { return bits_.data() + row_start(x, y); }
  const std::uint64_t* row(int x, int y) const { return bits_.data() + row_start(x, y); }

  /// @pre inside the grid, as everywhere in this class
  void insert(const Voxel& voxel) { insert_run(voxel[0], voxel[1], voxel[2], voxel[2]); }
  /// (x, y, first) … (x, y, last), nothing when last < first
  void insert_run(int x, int y, int first, int last);
  bool contains(const Voxel& voxel) const {
    return (row(voxel[0], voxel[1])[voxel[2] / 64] >> (voxel[2] % 64) & 1) != 0;
  }

  std::vector<Voxel> voxels() const;  ///< in lexicographic order

 private:
  std::size_t row_start(int x, int y) const {
    return (static_cast<std::size_t>(x) * static_cast<std::size_t>(resolution_) + static_cast<std::size_t>(y)) * words_;
  }

  int resolution_;
  std::size_t words_;
  std::vector<std::uint64_t> bits_;
};

}  // namespace anigen::geometry
