#include "anigen/nn/volume_layout.h"

namespace anigen::nn {

Tensor patchify(const Tensor& volume, std::int64_t patch) {
  TORCH_CHECK(volume.dim() == 5, "patchify: a volume has the shape [B, C, X, Y, Z], not ", volume.sizes());
  const std::int64_t b = volume.size(0), c = volume.size(1), p = patch;
  const std::int64_t x = volume.size(2), y = volume.size(3), z = volume.size(4);
  TORCH_CHECK(p > 0 && x % p == 0 && y % p == 0 && z % p == 0, "patchify: ", volume.sizes(),
              " does not divide into patches of ", p);
  const Tensor split = volume.reshape({b, c, x / p, p, y / p, p, z / p, p});
  return split.permute({0, 1, 3, 5, 7, 2, 4, 6}).reshape({b, c * p * p * p, x / p, y / p, z / p});
}

Tensor pixel_shuffle_3d(const Tensor& volume, std::int64_t scale) {
  TORCH_CHECK(volume.dim() == 5, "pixel shuffle: a volume has the shape [B, C, X, Y, Z], not ", volume.sizes());
  const std::int64_t b = volume.size(0), s = scale, cells = s * s * s;
  const std::int64_t x = volume.size(2), y = volume.size(3), z = volume.size(4);
  TORCH_CHECK(s > 0 && volume.size(1) % cells == 0, "pixel shuffle: ", volume.size(1),
              " channels are not a multiple of ", cells);
  const std::int64_t c = volume.size(1) / cells;
  const Tensor split = volume.reshape({b, c, s, s, s, x, y, z});
  if (volume.suggest_memory_format() == torch::MemoryFormat::ChannelsLast3d) {
    return split.permute({0, 5, 2, 6, 3, 7, 4, 1}).reshape({b, x * s, y * s, z * s, c}).permute({0, 4, 1, 2, 3});
  }
  return split.permute({0, 1, 5, 2, 6, 3, 7, 4}).reshape({b, c, x * s, y * s, z * s});
}

Tensor unpatchify(const Tensor& patches, std::int64_t patch) { return pixel_shuffle_3d(patches, patch); }

}  // namespace anigen::nn
