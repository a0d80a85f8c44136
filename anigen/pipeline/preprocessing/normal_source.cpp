#include "anigen/pipeline/preprocessing/normal_source.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/features/image_condition.h"
#include "anigen/io/image_resize.h"
#include "anigen/pipeline/preprocessing/foreground.h"
#include "anigen/pipeline/preprocessing/word_choice.h"

namespace anigen::pipeline {
namespace {

using torch::Tensor;

constexpr std::uint32_t kFacingTheViewer = 0x8080FFFFu;  // RGBA

io::Image opaque_resized(const io::Image& image, int width, int height) {
  return io::resize_lanczos(without_alpha(image), width, height, io::ResizeAlpha::kSeparate);
}

}  // namespace

NormalSource parse_normal_source(const std::string& word) {
  return chosen<NormalSource>("normals", word,
                              {{"auto", NormalSource::kAuto},
                               {"color", NormalSource::kColors},
                               {"estimator", NormalSource::kEstimator},
                               {"file", NormalSource::kFile},
                               {"flat", NormalSource::kFlat}});
}

io::Image normal_picture(const Tensor& normals) {
  TORCH_CHECK(normals.dim() == 4 && normals.size(0) == 1 && normals.size(1) == 3, "normals of one picture");
  const Tensor here = normals.detach().to(torch::kCPU, torch::kFloat32);
  if (!here.isfinite().all().item<bool>()) throw InputError("", "normals", "the estimate holds numbers not finite");
  const Tensor viewer = here * torch::tensor({-1.0F, 1.0F, 1.0F}).view({1, 3, 1, 1});
  const Tensor bytes =
      ((viewer + 1) / 2 * 255).clamp(0, 255).to(torch::kUInt8)[0].permute({1, 2, 0}).contiguous();  // [H, W, 3]
  io::Image image(static_cast<int>(bytes.size(1)), static_cast<int>(bytes.size(0)));
  const std::uint8_t* from = bytes.data_ptr<std::uint8_t>();
  for (std::size_t i = 0; i < image.rgba.size(); i += io::kImageChannels) {
    std::copy_n(from, 3, image.rgba.begin() + static_cast<std::ptrdiff_t>(i));
    from += 3;
  }
  return image;
}

io::Image estimated_normals(features::NormalEstimator& estimator, const io::Image& image, int largest_side,
                            const std::string& name) {
  const io::Image opaque = without_alpha(image);
  const io::Image seen = largest_side > 0 ? reduced(opaque, largest_side) : opaque;
  try {
    const torch::NoGradGuard no_grad;
    const Tensor normals = estimator.normals(features::color_tensor(seen).unsqueeze(0));
    return opaque_resized(normal_picture(normals), image.width, image.height);
  } catch (const InputError& error) {
    throw InputError(name, error.place(), error.problem());
  }
}

io::Image supplied_normals(const io::Image& map, int width, int height, const std::string& name) {
  const double across = static_cast<double>(map.width) / width, down = static_cast<double>(map.height) / height;
  // A hundredth, or what a pixel makes of a small picture.
  const double allowed = std::max({0.01, 1.0 / std::min(width, height), 1.0 / std::min(map.width, map.height)});
  if (std::abs(across / down - 1.0) > allowed) {
    throw InputError(name, "",
                     "a normal map of " + std::to_string(map.width) + " x " + std::to_string(map.height) +
                         " pixels does not fit a picture of " + std::to_string(width) + " x " + std::to_string(height) +
                         ": both must show the same frame");
  }
  return opaque_resized(map, width, height);
}

io::Image flat_normals(int width, int height) { return {width, height, kFacingTheViewer}; }

}  // namespace anigen::pipeline
