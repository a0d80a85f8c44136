#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::shape_field::test {

using torch::Tensor;
using DirectedEdge = std::pair<std::int64_t, std::int64_t>;

/// Edges of all faces in their direction, sorted. @param faces [F, 3] int64
inline std::vector<DirectedEdge> directed_edges(const Tensor& faces) {
  const Tensor rows = faces.contiguous();
  const std::int64_t* v = rows.data_ptr<std::int64_t>();
  std::vector<DirectedEdge> edges;
  for (std::int64_t f = 0; f < rows.size(0); ++f) {
    for (std::int64_t i = 0; i < 3; ++i) edges.emplace_back(v[3 * f + i], v[3 * f + (i + 1) % 3]);
  }
  std::sort(edges.begin(), edges.end());
  return edges;
}

/// Edges that are not shared by exactly two faces of opposite direction.
inline std::int64_t unmatched_edges(const Tensor& faces) {
  const std::vector<DirectedEdge> edges = directed_edges(faces);
  std::int64_t count = 0;
  for (const DirectedEdge& edge : edges) {
    const auto same = std::equal_range(edges.begin(), edges.end(), edge);
    const auto back = std::equal_range(edges.begin(), edges.end(), DirectedEdge{edge.second, edge.first});
    if (same.second - same.first != 1 || back.second - back.first != 1) ++count;
  }
  return count;
}

/// Volume enclosed by a closed surface; positive when its normals point outside.
inline double enclosed_volume(const Tensor& vertices, const Tensor& faces) {
  const Tensor points = vertices.detach().to(torch::kFloat64);
  const auto corner = [&](std::int64_t k) { return points.index_select(0, faces.select(1, k)); };
  return (corner(0) * torch::cross(corner(1), corner(2), 1)).sum().item<double>() / 6.0;
}

/// Relative difference of the derivative of `loss` along a direction from a central difference.
/// @param loss called with the values of `x` @param step short enough that no sign changes
template <typename Loss>
double directional_error(const Loss& loss, const Tensor& x, const Tensor& direction, double step) {
  const Tensor at = x.detach().clone().requires_grad_();
  const Tensor gradient = torch::autograd::grad({loss(at)}, {at})[0];
  const double slope = (gradient * direction).sum().template item<double>();
  const torch::NoGradGuard no_grad;
  const double ahead = loss(x + step * direction).template item<double>();
  const double behind = loss(x - step * direction).template item<double>();
  const double numeric = (ahead - behind) / (2.0 * step);
  return std::abs(slope - numeric) / (1e-6 + std::abs(numeric));
}

}  // namespace anigen::shape_field::test
