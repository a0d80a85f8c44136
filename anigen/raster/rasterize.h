#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::raster {

inline constexpr std::int64_t kMostPixelsPerSide = 16384;
inline constexpr std::int64_t kMostSubpixelBits = 12;  // positions and products of them then fit in 32 and 64 bits

/// A picture's pixels and the grid to which corners are snapped before coverage is decided.
struct Viewport {
  std::int64_t height = 0, width = 0;
  std::int64_t subpixel_bits = 4;  ///< steps of 1/2^bits pixel

  /// x/w of a column's centre, y/w of a row's.
  double x(std::int64_t column) const { return static_cast<double>(2 * column + 1) / static_cast<double>(width) - 1.0; }
  double y(std::int64_t row) const { return static_cast<double>(2 * row + 1) / static_cast<double>(height) - 1.0; }
  double half_width() const { return 0.5 * static_cast<double>(width); }
  double half_height() const { return 0.5 * static_cast<double>(height); }
};

/// A triangle as a pixel at (X, Y) sees it. With q_k = (x_k − X w_k, y_k − Y w_k), the unnormalised weights of the
/// corners are q1 × q2, q2 × q0, q0 × q1 (docs/reference/training.md, 8).
struct PixelTriangle {
  std::array<double, 3> qx, qy, weight;
  double sum;  ///< of the weights; 0: the triangle has no area as seen from here

  /// @param clip [V, 4] @param corners its three vertices
  PixelTriangle(const double* clip, const std::int64_t* corners, double x, double y) {
    double determinant = 0.0, largest_w = 0.0;
    for (std::size_t k = 0; k < 3; ++k) {
      const double* p = clip + 4 * corners[k];
      qx[k] = p[0] - x * p[3];
      qy[k] = p[1] - y * p[3];
      largest_w = std::max(largest_w, p[3]);
    }
    sum = 0.0;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
      weight[k] = qx[i] * qy[j] - qy[i] * qx[j];
      sum += weight[k];
      determinant += weight[k] * clip[4 * corners[k] + 3];
    }
    // At what is seen w is determinant / sum, and no more than at the farthest corner. A pixel that only snapping put
    // into the triangle may lie beyond its horizon.
    const double least = std::abs(determinant) / largest_w;
    if (!(determinant * sum > 0.0) || std::abs(sum) < least) sum = std::copysign(least, determinant);
    if (!std::isfinite(sum)) sum = 0.0;
  }

  /// u and v, clamped to [0, 1] and their sum to 1: snapping shows triangles a little beyond their edges.
  std::array<double, 2> barycentric() const {
    if (sum == 0.0) return {1.0 / 3.0, 1.0 / 3.0};
    const double u = std::clamp(weight[0] / sum, 0.0, 1.0), v = std::clamp(weight[1] / sum, 0.0, 1.0);
    const double shrink = 1.0 / std::max(u + v, 1.0);
    return {u * shrink, v * shrink};
  }

  /// From gradients of u and v those of (x_k, y_k, w_k); clamping passes them on unchanged.
  std::array<std::array<double, 3>, 3> gradients(double x, double y, double du, double dv) const {
    std::array<std::array<double, 3>, 3> corners{};
    if (sum == 0.0) return corners;
    const double common = (du * weight[0] + dv * weight[1]) / sum;
    const std::array<double, 3> dweight{(du - common) / sum, (dv - common) / sum, -common / sum};
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
      const double dx = dweight[j] * qy[i] - dweight[i] * qy[j], dy = dweight[i] * qx[j] - dweight[j] * qx[i];
      corners[k] = {dx, dy, -x * dx - y * dy};
    }
    return corners;
  }
};

using torch::Tensor;

/// Visible triangle and barycentric coordinates of every pixel. Row 0 is y/w = −1. Differentiable: gradients of
/// `barycentric` reach x, y, w of the vertices.
struct Fragments {
  Tensor barycentric;  ///< [H, W, 2]: u, v of the first and second corner, perspective correct; 0 for background
  Tensor depth;        ///< [H, W]: z/w in [-1, 1]; no gradient
  Tensor triangle;     ///< [H, W] int64: triangle + 1, 0 for background
};

/// Visibility of the nearest surface per pixel centre; no culling; triangles that reach behind the camera show as far
/// as they are in front of it. Positions are snapped to 1/2^subpixel_bits pixel for coverage only; the published system
/// has 1/16 pixel, finer steps come closer to exact coverage. Barycentrics are of the unsnapped triangle, clamped to
/// it; gradients pass the clamp. Runs on all threads of the CPU, with the same result for any number; tensors of other
/// devices are copied there and back. Can be differentiated once (docs/reference/training.md, 8).
/// @param clip [V, 4] fp32 or fp64 @param faces [F, 3] int64
/// @throws InputError on a bad index or size, and on a vertex that is not finite
Fragments rasterize(const Tensor& clip, const Tensor& faces, std::int64_t height, std::int64_t width,
                    std::int64_t subpixel_bits = 4);

/// u a₀ + v a₁ + (1−u−v) a₂ per pixel, 0 for background; differentiable in attributes and barycentric.
/// @param attributes [V', C] fp32 or fp64 @param faces [F, 3] int64 into attributes @return [H, W, C]
/// @throws InputError when shapes, types or indices do not fit
Tensor interpolate(const Tensor& attributes, const Fragments& fragments, const Tensor& faces);

}  // namespace anigen::raster
