#include "anigen/models/rignet/mean_shift.h"

#include "anigen/models/anymate/checks.h"

namespace anigen::models::rignet {
namespace {

constexpr double kOwnWeight = 1e-10;  // of a point in its own mean, so that the mean exists

}  // namespace

Tensor epanechnikov(const Tensor& points, const Tensor& bandwidth) {
  anymate::require_shape(points, {-1, 3}, "points");
  anymate::require_shape(bandwidth, {}, "bandwidth");
  // Squares by products of matrices: distances count only where they are of the order of h, far above the rounding.
  const Tensor squares = points.square().sum(1);
  const Tensor apart = squares.unsqueeze(1) + squares.unsqueeze(0) - 2.0 * points.mm(points.t());
  return torch::relu(bandwidth.square() - apart.clamp_min(0.0));
}

Tensor mean_shifted(const Tensor& points, const Tensor& attention, const Tensor& bandwidth, double step) {
  anymate::require_shape(attention, {points.size(0)}, "attention");
  const Tensor kernel = epanechnikov(points, bandwidth) * attention.unsqueeze(0);
  const Tensor weight = kernel.sum(1, true) + kOwnWeight;
  const Tensor mean = (kernel.mm(points) + kOwnWeight * points) / weight;
  return points + step * (mean - points);
}

}  // namespace anigen::models::rignet
