#include "anigen/features/condition_encoder.h"

#include <filesystem>
#include <system_error>
#include <utility>

#include "anigen/core/log.h"
#include "anigen/features/image_condition.h"
#include "anigen/models/dinov2_weights.h"
#include "anigen/models/patch_image_encoder.h"
#include "anigen/models/state_dict.h"

namespace anigen::features {
namespace {

constexpr const char* kEncoderName = "image_encoder";
constexpr const char* kModelName = "image_cond_model";
constexpr const char* kPublishedFolder = "ckpts/dinov2";

/// The weights where the published trainer has its DINOv2; nothing when they are not there.
std::optional<std::filesystem::path> published_weights(const std::string& model) {
  for (const char* extension : {".pth", ".safetensors"}) {
    const std::filesystem::path file =
        std::filesystem::path(kPublishedFolder) / (models::Dinov2Options::published_file_stem(model) + extension);
    std::error_code error;
    if (std::filesystem::is_regular_file(file, error)) return file;
  }
  return std::nullopt;
}

/// Frozen, so that replicas share it: its forward pass changes nothing.
class FrozenDinov2 : public ConditionEncoder {
 public:
  explicit FrozenDinov2(models::Dinov2 model) : model_(std::move(model)) {}
  Tensor tokens(const Tensor& images) override { return image_condition(model_, images); }
  std::unique_ptr<ConditionEncoder> replica() const override { return std::make_unique<FrozenDinov2>(model_); }

 private:
  models::Dinov2 model_;
};

class TrainedPatches : public ConditionEncoder {
 public:
  TrainedPatches(const models::PatchImageEncoderOptions& options, std::int64_t channels, torch::Device device,
                 nn::Init init)
      : model_(options, channels, init), channels_(channels), device_(device) {
    model_->to(device);
  }
  Tensor tokens(const Tensor& images) override {
    return model_->forward(images.to(device_, nn::dtype_of(model_->parameters().front())));
  }
  std::optional<nn::NamedModel> trained() const override { return nn::NamedModel{kEncoderName, model_.ptr()}; }
  std::unique_ptr<ConditionEncoder> replica() const override {
    auto twin = std::make_unique<TrainedPatches>(model_->options(), channels_, device_, nn::Init::kNone);
    models::load_state_dict(*twin->model_, models::state_dict(*model_), models::LoadMode::kStrict);
    return twin;
  }

 private:
  models::PatchImageEncoder model_;
  std::int64_t channels_;
  torch::Device device_;
};

/// @param reader, key where the name stands, for messages
std::unique_ptr<ConditionEncoder> make_dinov2(const ConfigReader& reader, const char* key, const std::string& name,
                                              const std::filesystem::path& weights, std::int64_t image_size,
                                              std::int64_t channels, torch::Device device) {
  const auto options = models::Dinov2Options::named(name);
  if (options.embed_dim != channels) {
    throw reader.error(key, "its tokens have " + std::to_string(options.embed_dim) +
                                " channels, the flow's cond_channels are " + std::to_string(channels));
  }
  if (image_size % options.patch_size != 0) {
    throw reader.error(key, "its patches of " + std::to_string(options.patch_size) +
                                " pixels do not divide the dataset's image_size, " + std::to_string(image_size));
  }
  models::Dinov2 model(options);
  models::load_dinov2_weights(model, weights);
  model->to(device);
  return std::make_unique<FrozenDinov2>(model);
}

}  // namespace

std::unique_ptr<ConditionEncoder> make_condition_encoder(ConfigReader& trainer_args, std::int64_t image_size,
                                                         std::int64_t channels, torch::Device device) {
  const std::string published_model = trainer_args.text(kModelName, "dinov2_vitl14_reg");
  if (!trainer_args.has(kEncoderName)) {
    const std::optional<std::filesystem::path> weights = published_weights(published_model);
    if (!weights) {
      throw trainer_args.error(
          kEncoderName, std::string("says what turns pictures into conditions; without it the weights of DINOv2 "
                                    "must lie in ") +
                            kPublishedFolder + "/" + models::Dinov2Options::published_file_stem(published_model) +
                            ".pth (or .safetensors). Put them there, or set {\"name\": \"dinov2\", "
                            "\"weights\": FILE}, or {\"name\": \"patch\"}, a small encoder trained with the flow");
    }
    log::info("conditions are tokens of {}", weights->string());
    return make_dinov2(trainer_args, kModelName, published_model, *weights, image_size, channels, device);
  }
  ConfigReader encoder = trainer_args.object(kEncoderName);
  encoder.require("name");
  if (encoder.choice("name", "", {"dinov2", "patch"}) == "dinov2") {
    encoder.require("weights");
    const std::string model = encoder.text("model", published_model), weights = encoder.text("weights", "");
    encoder.finish();
    return make_dinov2(encoder, "model", model, weights, image_size, channels, device);
  }
  const auto options = models::PatchImageEncoderOptions::from_json(*trainer_args.raw(kEncoderName), encoder.file(),
                                                                   trainer_args.pointer_to(kEncoderName));
  if (options.image_size != image_size) {
    throw encoder.error("image_size", "is " + std::to_string(options.image_size) + ", the dataset's image_size is " +
                                          std::to_string(image_size));
  }
  return std::make_unique<TrainedPatches>(options, channels, device, nn::Init::kPublished);
}

}  // namespace anigen::features
