#include "anigen/eval/image/views.h"

#include <algorithm>
#include <string>

#include "anigen/core/error.h"
#include "anigen/eval/image/psnr.h"
#include "anigen/eval/image/ssim.h"
#include "anigen/raytrace/picture.h"

namespace anigen::eval {

std::vector<io::Image> render_views(const io::RiggedShape& shape, const Similarity& placement,
                                    const ViewOptions& options) {
  if (options.views < 1 || options.views > 3600) throw InputError("", "views", "must be between 1 and 3600");
  if (!shape.has_surface()) throw InputError(shape.file, "", "a shape without faces has no pictures");
  Asset asset;
  asset.mesh = transformed(placement, shape.mesh);
  asset.materials = shape.materials;
  asset.images = shape.images;

  raytrace::PictureOptions picture;
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

  const raytrace::Scene scene(asset);
  std::vector<io::Image> images;
  for (int i = 0; i < options.views; ++i) {
    picture.view.yaw_degrees = 360.0 * i / options.views;
    images.push_back(raytrace::render(scene, picture));
  }
  return images;
}

ImageScores image_scores(const std::vector<io::Image>& prediction, const std::vector<io::Image>& truth,
                         const PerceptualDistance& perceptual) {
  if (prediction.empty() || prediction.size() != truth.size()) {
    throw InputError(
        "", "views",
        std::to_string(prediction.size()) + " pictures cannot be compared with " + std::to_string(truth.size()));
  }
  ImageScores scores;
  if (perceptual) scores.lpips = 0.0;
  const auto count = static_cast<double>(truth.size());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    scores.psnr += std::min(psnr(prediction[i], truth[i]), kLargestPsnr) / count;
    scores.ssim += ssim(prediction[i], truth[i]) / count;
    if (perceptual) *scores.lpips += perceptual(prediction[i], truth[i]) / count;
  }
  return scores;
}

}  // namespace anigen::eval
