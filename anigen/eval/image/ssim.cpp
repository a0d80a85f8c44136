#include "anigen/eval/image/ssim.h"

#include <Eigen/Core>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/eval/image/picture_pair.h"

namespace anigen::eval {
namespace {

constexpr int kWindow = 11;
constexpr double kSigma = 1.5, kC1 = 0.01 * 0.01, kC2 = 0.03 * 0.03;

using Plane = Eigen::ArrayXXd;  // [height, width]

Plane channel(const io::Image& image, int c) {
  Plane plane(image.height, image.width);
  for (int x = 0; x < image.width; ++x) {
    for (int y = 0; y < image.height; ++y) plane(y, x) = image.pixel(x, y)[c] / 255.0;
  }
  return plane;
}

Eigen::Array<double, kWindow, 1> gaussian() {
  Eigen::Array<double, kWindow, 1> weights;
  for (int i = 0; i < kWindow; ++i) {
    const double offset = (i - kWindow / 2) / kSigma;
    weights[i] = std::exp(-0.5 * offset * offset);
  }
  return weights / weights.sum();
}

/// The Gaussian is separable: columns, then rows; only where the window fits.
Plane blur(const Plane& plane, const Eigen::Array<double, kWindow, 1>& weights) {
  const Eigen::Index rows = plane.rows() - kWindow + 1, columns = plane.cols() - kWindow + 1;
  Plane tall = Plane::Zero(rows, plane.cols()), result = Plane::Zero(rows, columns);
  for (int i = 0; i < kWindow; ++i) tall += weights[i] * plane.middleRows(i, rows);
  for (int i = 0; i < kWindow; ++i) result += weights[i] * tall.middleCols(i, columns);
  return result;
}

}  // namespace

double ssim(const io::Image& a, const io::Image& b) {
  check_pair(a, b);
  if (a.width < kWindow || a.height < kWindow) {
    throw InputError("", "image", "SSIM needs pictures of at least 11 × 11 pixels");
  }
  const auto weights = gaussian();
  double sum = 0.0;
  for (int c = 0; c < 3; ++c) {
    const Plane x = channel(a, c), y = channel(b, c);
    const Plane mean_x = blur(x, weights), mean_y = blur(y, weights);
    const Plane variance_x = blur(x * x, weights) - mean_x * mean_x;
    const Plane variance_y = blur(y * y, weights) - mean_y * mean_y;
    const Plane covariance = blur(x * y, weights) - mean_x * mean_y;
    sum += ((2.0 * mean_x * mean_y + kC1) * (2.0 * covariance + kC2) /
            ((mean_x * mean_x + mean_y * mean_y + kC1) * (variance_x + variance_y + kC2)))
               .mean();
  }
  return sum / 3.0;
}

}  // namespace anigen::eval
