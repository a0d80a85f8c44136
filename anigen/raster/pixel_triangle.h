#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace anigen::raster {

/// A triangle as a pixel at (X, Y) sees it. With q_k = (x_k − X w_k, y_k − Y w_k), the unnormalised weights of the
/// corners are q1 × q2, q2 × q0, q0 × q1 (reference README-ops.md, rasterisation rules).
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

}  // namespace anigen::raster
