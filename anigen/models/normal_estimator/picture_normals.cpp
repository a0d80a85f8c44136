#include "anigen/models/normal_estimator/picture_normals.h"

#include "anigen/models/dinov2.h"

namespace anigen::models {
namespace {

std::int64_t missing_pixels(std::int64_t size) {
  return (kDsinePictureMultiple - size % kDsinePictureMultiple) % kDsinePictureMultiple;
}

}  // namespace

PicturePadding dsine_padding(std::int64_t height, std::int64_t width) {
  const std::int64_t rows = missing_pixels(height), columns = missing_pixels(width);
  return {columns / 2, columns - columns / 2, rows / 2, rows - rows / 2};
}

Tensor picture_normals(Dsine& network, const Tensor& rgb, int iterations) {
  const std::int64_t height = rgb.size(2), width = rgb.size(3);
  const PicturePadding padding = dsine_padding(height, width);
  const PinholeCamera camera = PinholeCamera::of_picture(height, width).padded(padding.left, padding.top);
  const Tensor picture = rgb.to(network->parameters().front().options());
  const Tensor framed = at::constant_pad_nd(picture, {padding.left, padding.right, padding.top, padding.bottom}, 0.0);
  const Tensor all = network->forward(imagenet_normalized(framed), camera, iterations);
  return all.narrow(2, padding.top, height).narrow(3, padding.left, width).contiguous();
}

}  // namespace anigen::models
