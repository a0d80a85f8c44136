#pragma once
#include <cstdint>
#include <vector>

#include "anigen/rig/binding/path_bounds.h"
#include "anigen/rig/binding/solid_voxels.h"

namespace anigen::rig {

/// Where paths begin, and what they have cost there.
struct PathSource {
  std::uint32_t cell;
  float distance;  ///< in cells, in [0, 2)
};

/// Length of the shortest path from the sources to every cell, over solid cells and their 26 neighbours with steps of
/// 1, √2 and √3 cells (reference anymate-baselines.md, 9.1, step 3); infinite where there is none, −infinite outside.
/// Dijkstra's algorithm with buckets one cell wide: no step is shorter than that, so a bucket is final before it is
/// opened and its order does not matter (Dial, "Algorithm 360: shortest-path forest with topological ordering", 1969;
/// Denardo and Fox, "Shortest-route methods: reaching, pruning and buckets", 1979). The result is exact but for the
/// rounding of sums to single precision. One thread: use as many objects as threads.
class VoxelPaths {
 public:
  explicit VoxelPaths(const SolidVoxels& solid);

  /// Paths that are longer than `bounds` in a cell end there: distances are exact where they are within them, and
  /// elsewhere the length of some path or infinite.
  /// @param before what every path costs besides, in cells, where it is compared with bounds
  /// @return [cells], without `before`, valid until the next run @pre sources are solid cells
  const std::vector<float>& run(const std::vector<PathSource>& sources, const PathBounds& bounds, double before);

 private:
  struct Step {
    std::ptrdiff_t offset;
    float length;
  };
  struct Entry {
    std::uint32_t cell;
    float distance;
  };
  void offer(std::size_t cell, float distance);

  const SolidVoxels* solid_;
  std::vector<Step> steps_;  ///< 26
  std::vector<float> distances_;
  std::vector<Entry> buckets_[3];
};

}  // namespace anigen::rig
