#include "anigen/pipeline/perceptual_metric.h"

#include <cmath>
#include <fstream>
#include <string_view>

#include "anigen/core/error.h"
#include "anigen/core/sha256.h"
#include "anigen/models/lpips_weights.h"
#include "anigen/pipeline/device.h"

namespace anigen::pipeline {
namespace {

/// In pieces: with its classifier, the published VGG16 has 528 MB.
std::string file_digest(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::vector<char> piece(std::size_t{1} << 20);
  Sha256 digest;
  while (in) {
    in.read(piece.data(), static_cast<std::streamsize>(piece.size()));
    digest.update(std::string_view(piece.data(), static_cast<std::size_t>(in.gcount())));
  }
  if (!in.eof()) throw InputError(file.string(), "", "cannot be read");
  return digest.finish();
}

/// [1, 3, H, W] in [0, 1]
torch::Tensor to_batch(const io::Image& image, const torch::Device& device) {
  const torch::Tensor pixels =
      torch::from_blob(const_cast<std::uint8_t*>(image.rgba.data()), {image.height, image.width, 4}, torch::kUInt8)
          .narrow(2, 0, 3);
  return pixels.permute({2, 0, 1}).unsqueeze(0).to(device, torch::kFloat32) / 255.0;
}

}  // namespace

PerceptualMetric::PerceptualMetric(const std::vector<std::filesystem::path>& weights, const std::string& device)
    : device_(parse_device(device)), lpips_(models::load_lpips(weights)) {
  lpips_->to(device_);
  description_ = {{"network", "LPIPS v0.1, VGG16"}, {"weights_sha256", Json::array()}};
  for (const std::filesystem::path& file : weights) description_["weights_sha256"].push_back(file_digest(file));
}

double PerceptualMetric::distance(const io::Image& a, const io::Image& b) {
  if (a.width != b.width || a.height != b.height) throw InputError("", "image", "LPIPS compares pictures of one size");
  for (const io::Image* image : {&a, &b}) {
    const std::size_t bytes =
        std::size_t{4} * static_cast<std::size_t>(image->width) * static_cast<std::size_t>(image->height);
    if (image->rgba.size() != bytes) throw InputError("", "image", "a picture is incomplete");
  }
  const std::lock_guard<std::mutex> one_at_a_time(mutex_);
  const torch::NoGradGuard no_grad;
  const double value = lpips_->forward(to_batch(a, device_), to_batch(b, device_)).item<double>();
  if (!std::isfinite(value)) throw InputError("", "lpips", "is not finite: the numbers of these weights overflow");
  return value;
}

}  // namespace anigen::pipeline
