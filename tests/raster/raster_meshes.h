#pragma once
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::raster {

struct ClipMesh {
  torch::Tensor clip, faces;
};

/// [N · 4] numbers → [N, 4] fp64
inline torch::Tensor clip_points(const std::vector<double>& values) {
  return torch::tensor(values, torch::kFloat64).view({-1, 4});
}

/// Every three vertices a triangle.
inline torch::Tensor separate_faces(std::int64_t triangles) {
  return torch::arange(3 * triangles, torch::kInt64).view({-1, 3});
}

/// columns × rows cells of two triangles over the rectangle [-reach, reach]² at z = 0, w = 1.
inline ClipMesh clip_grid(std::int64_t columns, std::int64_t rows, double reach) {
  std::vector<double> points;
  std::vector<std::int64_t> faces;
  for (std::int64_t r = 0; r <= rows; ++r) {
    for (std::int64_t c = 0; c <= columns; ++c) {
      const double x = 2.0 * static_cast<double>(c) / static_cast<double>(columns) - 1.0;
      const double y = 2.0 * static_cast<double>(r) / static_cast<double>(rows) - 1.0;
      points.insert(points.end(), {reach * x, reach * y, 0.0, 1.0});
      if (r == rows || c == columns) continue;
      const std::int64_t at = r * (columns + 1) + c, below = at + columns + 1;
      faces.insert(faces.end(), {at, at + 1, below, at + 1, below + 1, below});
    }
  }
  return {clip_points(points), torch::tensor(faces, torch::kInt64).view({-1, 3})};
}

/// Triangles all over and beyond the view volume; with `behind` also with corners behind the camera.
inline ClipMesh triangle_soup(std::int64_t triangles, bool behind) {
  const torch::Tensor random = 2.0 * torch::rand({3 * triangles, 4}, torch::kFloat64) - 1.0;
  torch::Tensor clip = torch::empty_like(random);
  if (behind) {
    clip.copy_(3.0 * random);
    clip.select(1, 3).add_(1.0);
  } else {
    const torch::Tensor w = 1.75 + 1.25 * random.narrow(1, 3, 1);
    clip.copy_(torch::cat({1.5 * random.narrow(1, 0, 2) * w, 1.2 * random.narrow(1, 2, 1) * w, w}, 1));
  }
  return {clip, separate_faces(triangles)};
}

}  // namespace anigen::raster
