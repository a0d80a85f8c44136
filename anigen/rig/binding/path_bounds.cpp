#include "anigen/rig/binding/path_bounds.h"

#include <algorithm>
#include <limits>

#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"

namespace anigen::rig {

PathBounds::PathBounds(const SolidVoxels& solid, std::size_t most)
    : solid_(&solid), most_(most), row_(at(solid.block.size[2])) {
  for (std::size_t axis = 0; axis < 3; ++axis) blocks_along_[axis] = (at(solid.block.size[axis]) + kSide - 1) / kSide;
  if (most_ == 0) return;
  for (int i = 0; i < solid.block.size[0]; ++i) {
    for (int j = 0; j < solid.block.size[1]; ++j) {
      block_of_row_.push_back((at(i) / kSide * blocks_along_[1] + at(j) / kSide) * blocks_along_[2]);
    }
  }
  nearest_.assign(blocks_along_[0] * blocks_along_[1] * blocks_along_[2] * most_, kUnbounded);
}

void PathBounds::add(const std::vector<std::pair<const std::vector<float>*, double>>& joints) {
  if (most_ == 0) return;
  const std::size_t rows = at(solid_->block.size[1]), slabs = at(solid_->block.size[0]);
  parallel_for(blocks_along_[0], [&](std::size_t slab) {
    std::vector<float> farthest(blocks_along_[1] * blocks_along_[2]);
    for (const auto& [distances, before] : joints) {
      // Outside is −∞, and so are the blocks that lie outside altogether.
      std::fill(farthest.begin(), farthest.end(), -std::numeric_limits<float>::infinity());
      for (std::size_t x = slab * kSide; x < std::min(slabs, (slab + 1) * kSide); ++x) {
        for (std::size_t y = 0; y < rows; ++y) {
          const float* row = distances->data() + (x * rows + y) * row_;
          float* blocks = farthest.data() + y / kSide * blocks_along_[2];
          for (std::size_t z = 0; z < row_; ++z) blocks[z / kSide] = std::max(blocks[z / kSide], row[z]);
        }
      }
      for (std::size_t b = 0; b < farthest.size(); ++b) {
        float* kept = nearest_.data() + (slab * farthest.size() + b) * most_;
        // Rounded up: a bound may be too large.
        const auto distance = static_cast<float>((static_cast<double>(farthest[b]) + before) * (1.0 + 1e-6) + 1e-3);
        if (!(distance < kept[most_ - 1])) continue;
        std::size_t place = most_ - 1;
        for (; place > 0 && distance < kept[place - 1]; --place) kept[place] = kept[place - 1];
        kept[place] = distance;
      }
    }
  });
}

}  // namespace anigen::rig
