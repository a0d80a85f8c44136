#include "anigen/models/dinov2_positions.h"

#include <cmath>

namespace anigen::models {
namespace {

// [1, C, M, M] → [1, C, rows, columns]
Tensor resample(const Tensor& grid, std::int64_t rows, std::int64_t columns, bool antialias, double offset) {
  const std::vector<std::int64_t> size = {rows, columns};
  if (offset == 0.0) {
    return antialias ? at::_upsample_bicubic2d_aa(grid, size, /*align_corners=*/false)
                     : at::upsample_bicubic2d(grid, size, /*align_corners=*/false);
  }
  const double along_rows = (static_cast<double>(rows) + offset) / static_cast<double>(grid.size(2));
  const double along_columns = (static_cast<double>(columns) + offset) / static_cast<double>(grid.size(3));
  return antialias ? at::_upsample_bicubic2d_aa(grid, size, /*align_corners=*/false, along_rows, along_columns)
                   : at::upsample_bicubic2d(grid, size, /*align_corners=*/false, along_rows, along_columns);
}

}  // namespace

Tensor interpolate_positions(const Tensor& pos_embed, std::int64_t rows, std::int64_t columns, bool antialias,
                             double offset) {
  const std::int64_t patches = pos_embed.size(1) - 1, channels = pos_embed.size(2);
  const auto side = static_cast<std::int64_t>(std::llround(std::sqrt(static_cast<double>(patches))));
  TORCH_CHECK(rows >= 1 && columns >= 1 && side * side == patches, "position embeddings of ", patches,
              " patches for a picture of ", rows, " x ", columns);
  if (rows == side && columns == side) return pos_embed;

  const Tensor wide = pos_embed.to(torch::kFloat32);
  const Tensor grid = wide.slice(1, 1).reshape({1, side, side, channels}).permute({0, 3, 1, 2}).contiguous();
  const Tensor resampled = resample(grid, rows, columns, antialias, offset).permute({0, 2, 3, 1});
  const Tensor all = torch::cat({wide.slice(1, 0, 1), resampled.reshape({1, rows * columns, channels})}, 1);
  return all.to(nn::dtype_of(pos_embed));
}

}  // namespace anigen::models
