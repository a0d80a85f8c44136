#include "anigen/features/dsine_normals.h"

#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/models/normal_estimator/dsine_weights.h"

namespace anigen::features {
namespace {

void check_normal_picture(const torch::Tensor& rgb) {
  TORCH_CHECK(rgb.dim() == 4 && rgb.size(0) == 1 && rgb.size(1) == 3 && rgb.size(2) > 0 && rgb.size(3) > 0,
              "normals of one picture [1, 3, H, W], not ", rgb.sizes());
  const std::int64_t height = rgb.size(2), width = rgb.size(3);
  const models::PicturePadding padding = models::dsine_padding(height, width);
  const std::int64_t rows = height + padding.top + padding.bottom, columns = width + padding.left + padding.right;
  if (rows <= kMostNormalPixels / columns) return;
  throw InputError("", "image",
                   "a picture of " + std::to_string(width) + " x " + std::to_string(height) +
                       " pixels is too large for the normal estimator, which takes up to " +
                       std::to_string(kMostNormalPixels) + " pixels (4096 x 4096); make it smaller");
}

}  // namespace

DsineNormals::DsineNormals(const std::filesystem::path& weights, const torch::Device& device)
    : network_(models::load_dsine(weights)) {
  network_->to(device);
}

DsineNormals::DsineNormals(models::Dsine network) : network_(std::move(network)) {}

torch::Tensor DsineNormals::normals(const torch::Tensor& rgb) {
  check_normal_picture(rgb);
  return models::picture_normals(network_, rgb).to(rgb.device(), torch::kFloat32);
}

}  // namespace anigen::features
