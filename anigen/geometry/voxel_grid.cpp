#include "anigen/geometry/voxel_grid.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"

namespace anigen::geometry {

namespace {

std::string text_of(const Voxel& voxel) {
  return "(" + std::to_string(voxel[0]) + ", " + std::to_string(voxel[1]) + ", " + std::to_string(voxel[2]) + ")";
}

/// The set grown by `radius` along one of the first two axes: every row becomes the union of its neighbours.
VoxelBits grow_rows(const VoxelBits& set, int radius, std::size_t axis) {
  const int r = set.resolution();
  VoxelBits result(r);
  for (int x = 0; x < r; ++x) {
    for (int y = 0; y < r; ++y) {
      const std::uint64_t* from = set.row(x, y);
      if (std::all_of(from, from + set.words(), [](std::uint64_t word) { return word == 0; })) continue;
      const int at = axis == 0 ? x : y;
      for (int i = std::max(0, at - radius); i <= std::min(r - 1, at + radius); ++i) {
        std::uint64_t* to = axis == 0 ? result.row(i, y) : result.row(x, i);
        for (std::size_t w = 0; w < set.words(); ++w) to[w] |= from[w];
      }
    }
  }
  return result;
}

VoxelBits dilated(const std::vector<Voxel>& voxels, int resolution, int radius) {
  VoxelBits bits(resolution);
  const int reach = std::min(radius, resolution);
  for (const Voxel& v : voxels)
    bits.insert_run(v[0], v[1], std::max(0, v[2] - reach), std::min(resolution - 1, v[2] + reach));
  return reach == 0 ? bits : grow_rows(grow_rows(bits, reach, 1), reach, 0);
}

void set_bits(std::uint64_t* word, std::uint64_t mask) {
  // Most voxels are met by several triangles: looking first spares the locked instruction.
  if ((__atomic_load_n(word, __ATOMIC_RELAXED) & mask) == mask) return;
  __atomic_fetch_or(word, mask, __ATOMIC_RELAXED);
}

/// Rounds toward minus infinity, so that blocks are alike on both sides of 0.
std::int32_t block_of(std::int32_t index, int factor) {
  return index >= 0 ? index / factor : -((-static_cast<std::int64_t>(index) + factor - 1) / factor);
}

}  // namespace

void require_resolution(int resolution) {
  if (resolution >= 1 && resolution <= kMaxVoxelResolution) return;
  throw InputError("", "resolution",
                   "a voxel grid has 1 to " + std::to_string(kMaxVoxelResolution) + " voxels along each axis, not " +
                       std::to_string(resolution));
}

void require_inside(const std::vector<Voxel>& voxels, int resolution) {
  require_resolution(resolution);
  for (std::size_t i = 0; i < voxels.size(); ++i) {
    for (const std::int32_t index : voxels[i]) {
      if (index >= 0 && index < resolution) continue;
      throw InputError("", "voxels[" + std::to_string(i) + "]",
                       text_of(voxels[i]) + " lies outside a grid of resolution " + std::to_string(resolution));
    }
  }
}

Eigen::Vector3d voxel_center(const Voxel& voxel, int resolution) {
  const auto along = [&](std::size_t axis) { return (voxel[axis] + 0.5) / resolution - 0.5; };
  return {along(0), along(1), along(2)};
}

Voxel voxel_at(const Eigen::Vector3d& point, int resolution) {
  require_resolution(resolution);
  Voxel voxel{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double index = std::trunc((point[static_cast<Eigen::Index>(axis)] + 0.5) * resolution);
    if (!(index >= 0.0 && index < resolution)) {  // also when it is NaN
      throw InputError("", "point",
                       "(" + std::to_string(point.x()) + ", " + std::to_string(point.y()) + ", " +
                           std::to_string(point.z()) + ") lies outside the cube [-0.5, 0.5)");
    }
    voxel[axis] = static_cast<std::int32_t>(index);
  }
  return voxel;
}

std::array<Eigen::Vector3d, 8> sub_voxel_points(const Voxel& voxel, int resolution) {
  const Eigen::Vector3d center = voxel_center(voxel, resolution);
  const double step = 0.25 / resolution;
  std::array<Eigen::Vector3d, 8> points;
  for (std::size_t i = 0; i < 8; ++i) {
    points[i] =
        center + Eigen::Vector3d((i & 4) != 0 ? step : -step, (i & 2) != 0 ? step : -step, (i & 1) != 0 ? step : -step);
  }
  return points;
}

void sort_unique(std::vector<Voxel>& voxels) {
  std::sort(voxels.begin(), voxels.end());
  voxels.erase(std::unique(voxels.begin(), voxels.end()), voxels.end());
}

std::vector<Voxel> dilate(const std::vector<Voxel>& voxels, int resolution, int radius) {
  require_inside(voxels, resolution);
  if (radius < 0) throw InputError("", "radius", "a dilation radius cannot be negative");
  return dilated(voxels, resolution, radius).voxels();
}

std::vector<Voxel> dilate_randomly(const std::vector<Voxel>& voxels, int resolution, int radius,
                                   const std::function<double()>& draw) {
  require_inside(voxels, resolution);
  if (radius < 0) throw InputError("", "radius", "a dilation radius cannot be negative");
  const int clamped = std::min(radius, resolution);
  const VoxelBits small = clamped <= 1 ? VoxelBits(resolution) : dilated(voxels, resolution, clamped - 1);
  std::vector<Voxel> result;
  // The smaller dilation is part of the larger one, so only what it lacks is drawn for.
  for (const Voxel& voxel : dilated(voxels, resolution, clamped + 1).voxels()) {
    if (small.contains(voxel) || !(draw() < 0.5)) result.push_back(voxel);
  }
  return result;
}

VoxelBits::VoxelBits(int resolution)
    : resolution_(resolution),
      words_((static_cast<std::size_t>(resolution) + 63) / 64),
      bits_(static_cast<std::size_t>(resolution) * static_cast<std::size_t>(resolution) * words_) {}

void VoxelBits::insert_run(int x, int y, int first, int last) {
  std::uint64_t* words = row(x, y);
  for (int start = first; start <= last;) {
    const int end = std::min(last, start | 63);  // the last voxel of this word
    const std::uint64_t ones = ~std::uint64_t{0} >> (63 - (end - start));
    set_bits(words + start / 64, ones << (start % 64));
    start = end + 1;
  }
}

std::vector<Voxel> VoxelBits::voxels() const {
  std::size_t count = 0;
  for (const std::uint64_t word : bits_) count += static_cast<std::size_t>(__builtin_popcountll(word));
  std::vector<Voxel> result;
  result.reserve(count);
  for (int x = 0; x < resolution_; ++x) {
    for (int y = 0; y < resolution_; ++y) {
      const std::uint64_t* words = row(x, y);
      for (std::size_t w = 0; w < words_; ++w) {
        for (std::uint64_t left = words[w]; left != 0; left &= left - 1) {
          result.push_back({x, y, static_cast<std::int32_t>(w) * 64 + __builtin_ctzll(left)});
        }
      }
    }
  }
  return result;
}

std::vector<Voxel> pool_voxels(const std::vector<Voxel>& voxels, int factor) {
  if (factor < 1) throw InputError("", "factor", "cannot pool blocks of " + std::to_string(factor) + " voxels");
  std::vector<Voxel> pooled = voxels;
  for (Voxel& voxel : pooled) {
    for (std::int32_t& index : voxel) index = block_of(index, factor);
  }
  sort_unique(pooled);
  return pooled;
}

PooledVoxels pool_features(const std::vector<Voxel>& voxels, const std::vector<float>& features, std::size_t channels,
                           int factor) {
  if (features.size() != voxels.size() * channels) {
    throw InputError("", "features",
                     std::to_string(features.size()) + " numbers for " + std::to_string(voxels.size()) + " voxels of " +
                         std::to_string(channels) + " channels");
  }
  PooledVoxels result;
  result.voxels = pool_voxels(voxels, factor);
  result.features.resize(result.voxels.size() * channels);
  std::vector<float> count(result.voxels.size(), 1.0f);
  for (std::size_t v = 0; v < voxels.size(); ++v) {
    Voxel block = voxels[v];
    for (std::int32_t& index : block) index = block_of(index, factor);
    const auto found = std::lower_bound(result.voxels.begin(), result.voxels.end(), block);
    const auto row = static_cast<std::size_t>(found - result.voxels.begin());
    count[row] += 1.0f;
    for (std::size_t c = 0; c < channels; ++c) result.features[row * channels + c] += features[v * channels + c];
  }
  for (std::size_t row = 0; row < count.size(); ++row) {
    for (std::size_t c = 0; c < channels; ++c) result.features[row * channels + c] /= count[row];
  }
  return result;
}

}  // namespace anigen::geometry
