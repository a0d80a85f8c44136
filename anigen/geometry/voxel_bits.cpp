#include "anigen/geometry/voxel_bits.h"

#include <algorithm>

namespace anigen::geometry {
namespace {

void set_bits(std::uint64_t* word, std::uint64_t mask) {
  // Most voxels are met by several triangles: looking first spares the locked instruction.
  if ((__atomic_load_n(word, __ATOMIC_RELAXED) & mask) == mask) return;
  __atomic_fetch_or(word, mask, __ATOMIC_RELAXED);
}

}  // namespace

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

}  // namespace anigen::geometry
