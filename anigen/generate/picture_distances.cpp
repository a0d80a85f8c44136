#include "anigen/generate/picture_distances.h"

#include <cmath>
#include <cstdint>

#include "anigen/core/error.h"
#include "anigen/core/hash.h"
#include "anigen/core/run_folder.h"
#include "anigen/generate/field_rigger.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"

namespace anigen::generate {

namespace {

using torch::Tensor;

/// [1, 3, H, W] in [0, 1]
Tensor to_batch(const io::Image& image, const torch::Device& device) {
  const Tensor pixels =
      torch::from_blob(const_cast<std::uint8_t*>(image.rgba.data()), {image.height, image.width, 4}, torch::kUInt8)
          .narrow(2, 0, 3);
  return pixels.permute({2, 0, 1}).unsqueeze(0).to(device, torch::kFloat32) / 255.0;
}

void require_comparable(const io::Image& a, const io::Image& b) {
  if (a.width != b.width || a.height != b.height)
    throw InputError("", "image", "a learned distance compares pictures of one size");
  for (const io::Image* image : {&a, &b}) {
    const std::size_t bytes =
        std::size_t{4} * static_cast<std::size_t>(image->width) * static_cast<std::size_t>(image->height);
    if (image->rgba.size() != bytes || bytes == 0) throw InputError("", "image", "a picture is incomplete");
  }
}

io::Image opaque(io::Image image) {
  for (std::size_t i = 3; i < image.rgba.size(); i += 4) image.rgba[i] = 255;
  return image;
}

/// @throws InputError also for a flow that sees no colours
vision::FlowEncoder color_encoder_of(const std::filesystem::path& flow, const std::string& device) {
  const RunFolder run{flow};
  const Json config = load_config(run.config());
  if (is_rig_flow(flow)) throw InputError(run.config().string(), "/dataset/name", "was trained without images");
  if (config.value("/dataset/args/condition"_json_pointer, "color") != "color") {
    throw InputError(run.config().string(), "/dataset/args/condition",
                     "this encoder sees normals, and views show colours");
  }
  return vision::flow_encoder_of(flow, nn::parse_device(device));
}

/// SHA-256 of a flow's config, of its encoder's weights where it has any, and of the runs whose networks the encoder
/// asks.
Json encoder_files(const std::filesystem::path& flow) {
  const std::filesystem::path config = RunFolder{flow}.config();
  Json files = {{"config_sha256", sha256_of_file(config)}};
  const Json options = load_config(config).value("/trainer/args/image_encoder"_json_pointer, Json::object());
  if (options.value("name", "") != "patch") return files;
  const auto weights = [](const std::filesystem::path& run, const char* model) {
    return sha256_of_file(nn::newest_checkpoint(run, model));
  };
  files["weights_sha256"] = weights(flow, "image_encoder");
  const auto other = [&](const char* key) {
    return nn::named_run(flow, options.at(key).get<std::string>(), config,
                         std::string("/trainer/args/image_encoder/") + key);
  };
  if (options.contains("estimator")) files["estimator_sha256"] = weights(other("estimator"), "estimator");
  if (options.contains("flow")) files["flow"] = encoder_files(other("flow"));
  return files;
}

double finite(double value, const char* metric) {
  if (!std::isfinite(value)) throw InputError("", metric, "is not finite: the numbers of these weights overflow");
  return value;
}

}  // namespace

LpipsDistance::LpipsDistance(const std::vector<std::filesystem::path>& weights, const std::string& device)
    : device_(nn::parse_device(device)), lpips_(vision::load_lpips(weights)) {
  lpips_->to(device_);
  description_ = {{"network", "LPIPS v0.1, VGG16"}, {"weights_sha256", Json::array()}};
  for (const std::filesystem::path& file : weights) description_["weights_sha256"].push_back(sha256_of_file(file));
}

double LpipsDistance::distance(const io::Image& a, const io::Image& b) {
  require_comparable(a, b);
  const std::lock_guard<std::mutex> one_at_a_time(mutex_);
  const torch::NoGradGuard no_grad;
  return finite(lpips_->forward(to_batch(a, device_), to_batch(b, device_)).item<double>(), "lpips");
}

EncoderDistance::EncoderDistance(const std::filesystem::path& flow, const std::string& device)
    : flow_(color_encoder_of(flow, device)) {
  description_ = encoder_files(flow);
}

double EncoderDistance::distance(const io::Image& a, const io::Image& b) {
  require_comparable(a, b);
  const auto size = static_cast<int>(flow_.image_size);
  const Tensor pictures = torch::stack({vision::view_image(opaque(a), size), vision::view_image(opaque(b), size)});
  const std::lock_guard<std::mutex> one_at_a_time(mutex_);
  const torch::NoGradGuard no_grad;
  const Tensor tokens = flow_.encoder->tokens(pictures).to(torch::kCPU, torch::kFloat64);
  const Tensor cosines = torch::cosine_similarity(tokens[0], tokens[1], /*dim=*/1, /*eps=*/1e-12);
  return finite((1.0 - cosines).mean().item<double>(), "encoder_distance");
}

}  // namespace anigen::generate
