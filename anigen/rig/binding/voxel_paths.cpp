#include "anigen/rig/binding/voxel_paths.h"

#include <cmath>
#include <limits>

namespace anigen::rig {

VoxelPaths::VoxelPaths(const SolidVoxels& solid) : solid_(&solid), distances_(solid.states.size()) {
  const auto x = static_cast<std::ptrdiff_t>(solid.block.stride(0));
  const auto y = static_cast<std::ptrdiff_t>(solid.block.stride(1));
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        const int squared = dx * dx + dy * dy + dz * dz;
        if (squared > 0) steps_.push_back({dx * x + dy * y + dz, std::sqrt(static_cast<float>(squared))});
      }
    }
  }
}

void VoxelPaths::offer(std::size_t cell, float distance) {
  // Cells outside hold −∞: one comparison tells them, too.
  if (!(distance < distances_[cell])) return;
  distances_[cell] = distance;
  buckets_[static_cast<std::uint32_t>(static_cast<std::int32_t>(distance)) % 3].push_back(
      {static_cast<std::uint32_t>(cell), distance});
}

const std::vector<float>& VoxelPaths::run(const std::vector<PathSource>& sources, const PathBounds& bounds,
                                          double before) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  for (std::size_t cell = 0; cell < distances_.size(); ++cell) {
    distances_[cell] = solid_->is_solid(cell) ? kInfinity : -kInfinity;
  }
  for (const PathSource& source : sources) offer(source.cell, source.distance);
  // The longest step is shorter than two buckets, so from a bucket paths reach the next two.
  for (std::size_t bucket = 0, empty = 0; empty < 3; ++bucket) {
    std::vector<Entry>& entries = buckets_[bucket % 3];
    empty = entries.empty() ? empty + 1 : 0;
    for (const Entry& entry : entries) {
      if (entry.distance != distances_[entry.cell]) continue;  // a shorter path was found since
      if (entry.distance + before > static_cast<double>(bounds.at_cell(entry.cell))) continue;
      for (const Step& step : steps_) {
        offer(static_cast<std::size_t>(static_cast<std::ptrdiff_t>(entry.cell) + step.offset),
              entry.distance + step.length);
      }
    }
    entries.clear();
  }
  return distances_;
}

}  // namespace anigen::rig
