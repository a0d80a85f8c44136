#include "anigen/features/voxel_neighbours.h"

#include <algorithm>
#include <string>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::features {
namespace {

std::string text(const geometry::Voxel& voxel) {
  return "(" + std::to_string(voxel[0]) + ", " + std::to_string(voxel[1]) + ", " + std::to_string(voxel[2]) + ")";
}

}  // namespace

VoxelNeighbours::VoxelNeighbours(const std::vector<geometry::Voxel>& voxels, int resolution) : resolution_(resolution) {
  geometry::require_inside(voxels, resolution);
  places_.reserve(voxels.size());
  for (std::size_t i = 0; i < voxels.size(); ++i) places_.emplace_back(key(voxels[i]), i);
  std::sort(places_.begin(), places_.end());
  for (std::size_t i = 1; i < places_.size(); ++i) {
    if (places_[i].first != places_[i - 1].first) continue;
    const std::size_t twice = places_[i].second;
    throw InputError("", "voxel " + std::to_string(twice), text(voxels[twice]) + " is given twice");
  }
}

std::int64_t VoxelNeighbours::key(const geometry::Voxel& voxel) const {
  const std::int64_t size = resolution_;
  return (voxel[2] * size + voxel[1]) * size + voxel[0];
}

std::vector<std::size_t> VoxelNeighbours::within(const geometry::Voxel& voxel, int radius) const {
  const auto low = [&](std::int32_t i) { return std::max(i - radius, 0); };
  const auto high = [&](std::int32_t i) { return std::min(i + radius, resolution_ - 1); };
  std::vector<std::size_t> found;
  for (std::int32_t z = low(voxel[2]); z <= high(voxel[2]); ++z) {
    for (std::int32_t y = low(voxel[1]); y <= high(voxel[1]); ++y) {
      // The keys of one row along x follow each other.
      const std::int64_t last = key({high(voxel[0]), y, z});
      const auto first = std::make_pair(key({low(voxel[0]), y, z}), std::size_t{0});
      for (auto at = std::lower_bound(places_.begin(), places_.end(), first); at != places_.end() && at->first <= last;
           ++at) {
        found.push_back(at->second);
      }
    }
  }
  return found;
}

}  // namespace anigen::features
