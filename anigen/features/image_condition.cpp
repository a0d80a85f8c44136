#include "anigen/features/image_condition.h"

#include <vector>

#include "anigen/io/image_crop.h"
#include "anigen/io/image_planes.h"
#include "anigen/io/image_resize.h"
#include "anigen/nn/layer_norm.h"

namespace anigen::features {
namespace {

constexpr double kConditionEps = 1e-5;

Tensor planes_tensor(const std::vector<float>& planes, int height, int width) {
  return torch::tensor(planes).view({3, height, width});
}

}  // namespace

Tensor condition_image(const io::Image& image, int size, const std::string& name) {
  const io::Image part = io::crop(image, io::condition_box(image, name));
  return view_image(part, size);
}

io::Image inference_image(const io::Image& image, int size, const std::string& name) {
  const io::Image part = io::crop(image, io::inference_box(image, name));
  return io::composed_on_black(io::resize_lanczos(part, size, size, io::ResizeAlpha::kPremultiplied));
}

Tensor view_image(const io::Image& image, int size) {
  const io::Image resized = io::resize_lanczos(image, size, size, io::ResizeAlpha::kPremultiplied);
  return planes_tensor(io::premultiplied_planes(resized), size, size);
}

Tensor color_tensor(const io::Image& image) {
  return planes_tensor(io::color_planes(image), image.height, image.width);
}

Tensor image_condition(models::Dinov2& model, const Tensor& images) {
  const torch::NoGradGuard no_grad;
  const Tensor any_weight = model->parameters().front();
  const Tensor here = images.to(any_weight.device(), nn::dtype_of(any_weight));
  const Tensor tokens = model->tokens_after(models::imagenet_normalized(here), model->options().depth);
  return nn::layer_norm(tokens, kConditionEps);
}

Tensor null_condition(const Tensor& condition) { return torch::zeros_like(condition); }

}  // namespace anigen::features
