#include "anigen/metrics/image.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>

#include "anigen/core/error.h"
#include "anigen/render/picture.h"

namespace anigen::metrics {

namespace {

bool sound(const io::Image& image) {
  return image.width > 0 && image.height > 0 &&
         image.rgba.size() == 4 * static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
}

std::string size_of(const io::Image& image) {
  return std::to_string(image.width) + " × " + std::to_string(image.height);
}

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

/// @throws InputError when the pictures are not of one size, are empty, or do not hold 4 bytes per pixel
void check_pair(const io::Image& a, const io::Image& b) {
  if (!sound(a) || !sound(b)) throw InputError("", "image", "a picture is empty or incomplete");
  if (a.width != b.width || a.height != b.height)
    throw InputError("", "image", "pictures of " + size_of(a) + " and " + size_of(b) + " pixels cannot be compared");
}

}  // namespace

double psnr(const io::Image& a, const io::Image& b) {
  check_pair(a, b);
  std::int64_t sum = 0;  // of integers: exact in any order
  for (std::size_t i = 0; i < a.rgba.size(); ++i) {
    if (i % 4 == 3) continue;
    const int difference = int{a.rgba[i]} - int{b.rgba[i]};
    sum += std::int64_t{difference} * difference;
  }
  if (sum == 0) return std::numeric_limits<double>::infinity();
  const double values = 3.0 * a.width * a.height;
  return 10.0 * std::log10(255.0 * 255.0 * values / static_cast<double>(sum));
}

double ssim(const io::Image& a, const io::Image& b) {
  check_pair(a, b);
  if (a.width < kWindow || a.height < kWindow)
    throw InputError("", "image", "SSIM needs pictures of at least 11 × 11 pixels");
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

std::vector<io::Image> render_views(const io::RiggedShape& shape, const Similarity& placement,
                                    const ViewOptions& options) {
  require_between(options.views, 1, 3600, "views");
  if (!shape.has_surface()) throw InputError(shape.file, "", "a shape without faces has no pictures");
  Asset asset;
  asset.mesh = transformed(placement, shape.mesh);
  asset.materials = shape.materials;
  asset.images = shape.images;

  render::PictureOptions picture;
  picture.width = picture.height = options.size;
  picture.background = Eigen::Vector3f::Zero();
  // Noise from few occlusion rays would be the largest difference between two equal surfaces.
  picture.ambient_occlusion = false;
  picture.shadows = false;
  picture.view.pitch_degrees = options.pitch_degrees;
  picture.view.fov_degrees = options.fov_degrees;
  picture.view.distance = options.distance;
  // The camera looks at the centre of the frame, not of this shape.
  picture.view.fit = Box{Eigen::Vector3d::Constant(-0.5), Eigen::Vector3d::Constant(0.5)};

  const render::Scene scene(asset);
  std::vector<io::Image> images;
  for (int i = 0; i < options.views; ++i) {
    picture.view.yaw_degrees = 360.0 * i / options.views;
    images.push_back(render::render(scene, picture));
  }
  return images;
}

ImageScores image_scores(const std::vector<io::Image>& prediction, const std::vector<io::Image>& truth,
                         const PerceptualDistances& perceptual) {
  if (prediction.empty() || prediction.size() != truth.size()) {
    throw InputError(
        "", "views",
        std::to_string(prediction.size()) + " pictures cannot be compared with " + std::to_string(truth.size()));
  }
  ImageScores scores;
  if (perceptual.lpips) scores.lpips = 0.0;
  if (perceptual.encoder) scores.encoder = 0.0;
  const auto count = static_cast<double>(truth.size());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    scores.psnr += std::min(psnr(prediction[i], truth[i]), kLargestPsnr) / count;
    scores.ssim += ssim(prediction[i], truth[i]) / count;
    if (scores.lpips) *scores.lpips += perceptual.lpips(prediction[i], truth[i]) / count;
    if (scores.encoder) *scores.encoder += perceptual.encoder(prediction[i], truth[i]) / count;
  }
  return scores;
}

}  // namespace anigen::metrics
