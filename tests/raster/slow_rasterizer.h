#pragma once
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::raster {

/// Visible triangle of one pixel by the definition: of all triangles that hold the ray through its centre, the nearest.
struct SlowPixel {
  std::int64_t triangle = 0;  ///< + 1
  double u = 0.0, v = 0.0, depth = 0.0;
  bool sure = true;  ///< no edge or clip plane passes within 0.01 pixel, and no other surface lies at the same depth
};

/// Every triangle at every pixel, in homogeneous coordinates, without clipping or projecting a single vertex.
/// @param clip [V, 4] fp64
inline std::vector<SlowPixel> slow_rasterize(const torch::Tensor& clip, const torch::Tensor& faces, std::int64_t height,
                                             std::int64_t width) {
  const auto p = clip.accessor<double, 2>();
  const auto f = faces.accessor<std::int64_t, 2>();
  const double step_x = 2.0 / static_cast<double>(width), step_y = 2.0 / static_cast<double>(height);
  std::vector<SlowPixel> pixels;
  for (std::int64_t row = 0; row < height; ++row) {
    for (std::int64_t column = 0; column < width; ++column) {
      const double x = (static_cast<double>(column) + 0.5) * step_x - 1.0;
      const double y = (static_cast<double>(row) + 0.5) * step_y - 1.0;
      SlowPixel pixel;
      double nearest = std::numeric_limits<double>::infinity(), second = nearest;
      for (std::int64_t t = 0; t < f.size(0); ++t) {
        double weight[3], sum = 0.0, determinant = 0.0, closest = 1e30, z[3] = {0.0, 0.0, 0.0};
        for (std::int64_t k = 0; k < 3; ++k) {
          const auto a = p[f[t][(k + 1) % 3]], b = p[f[t][(k + 2) % 3]], own = p[f[t][k]];
          const double n[3] = {a[1] * b[3] - a[3] * b[1], a[3] * b[0] - a[0] * b[3], a[0] * b[1] - a[1] * b[0]};
          weight[k] = n[0] * x + n[1] * y + n[2];
          sum += weight[k];
          closest = std::min(closest, std::abs(weight[k]) / std::hypot(n[0] * step_x, n[1] * step_y));
          if (k == 0) determinant = n[0] * own[0] + n[1] * own[1] + n[2] * own[3];
          for (std::int64_t i = 0; i < 3; ++i) z[i] += own[2] * n[i];
        }
        const double depth = (z[0] * x + z[1] * y + z[2]) / determinant;
        const double steepness = std::hypot(z[0] * step_x, z[1] * step_y) / std::abs(determinant);
        const double to_clip_plane = std::abs(std::abs(depth) - 1.0) / steepness;
        const bool inside = weight[0] / sum >= 0.0 && weight[1] / sum >= 0.0 && weight[2] / sum >= 0.0;
        const bool before_eye = determinant / sum > 0.0;
        if (closest < 0.01 || (inside && to_clip_plane < 0.01)) pixel.sure = false;
        if (!inside || !before_eye || !(std::abs(depth) <= 1.0)) continue;
        second = std::min(second, std::max(nearest, depth));
        if (depth >= nearest) continue;
        nearest = depth;
        pixel.triangle = t + 1;
        pixel.u = weight[0] / sum;
        pixel.v = weight[1] / sum;
        pixel.depth = depth;
      }
      if (second - nearest < 1e-9) pixel.sure = false;
      pixels.push_back(pixel);
    }
  }
  return pixels;
}

}  // namespace anigen::raster
