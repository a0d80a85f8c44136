#include "anigen/vision/condition.h"

#include <system_error>
#include <utility>
#include <vector>

#include "anigen/core/log.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/io/image_resize.h"
#include "anigen/nn/norms.h"
#include "anigen/vision/patch_encoder.h"
#include "anigen/vision/picture_estimator.h"

namespace anigen::vision {

namespace {

constexpr double kConditionEps = 1e-5;

Tensor planes_tensor(const std::vector<float>& planes, int height, int width) {
  return torch::tensor(planes).view({3, height, width});
}

constexpr const char* kEncoderName = "image_encoder";
constexpr const char* kModelName = "image_cond_model";
constexpr const char* kPublishedModel = "dinov2_vitl14_reg";
constexpr const char* kPublishedFolder = "ckpts/dinov2";

/// The weights where the published trainer has its DINOv2; nothing when they are not there.
std::optional<std::filesystem::path> published_weights(const std::string& model) {
  for (const char* extension : {".pth", ".safetensors"}) {
    const std::filesystem::path file =
        std::filesystem::path(kPublishedFolder) / (Dinov2Options::published_file_stem(model) + extension);
    std::error_code error;
    if (std::filesystem::is_regular_file(file, error)) return file;
  }
  return std::nullopt;
}

/// Frozen, so that replicas share it: its forward pass changes nothing.
class FrozenDinov2 : public ConditionEncoder {
 public:
  explicit FrozenDinov2(Dinov2 model) : model_(std::move(model)) {}
  Tensor tokens(const Tensor& images) override { return image_condition(model_, images); }
  std::unique_ptr<ConditionEncoder> replica() const override { return std::make_unique<FrozenDinov2>(model_); }

 private:
  Dinov2 model_;
};

/// Image encoder of another flow, frozen.
struct FlowTokens {
  std::shared_ptr<ConditionEncoder> encoder;
  std::int64_t channels = 0;
};

class TrainedPatches : public ConditionEncoder {
 public:
  /// @param estimator, flow frozen, so that replicas share them; null unless options name them
  TrainedPatches(const PatchImageEncoderOptions& options, PictureEstimator estimator, FlowTokens flow,
                 std::int64_t channels, torch::Device device, nn::Init init)
      : model_(options, channels, init, flow.channels),
        estimator_(std::move(estimator)),
        flow_(std::move(flow)),
        channels_(channels),
        device_(device) {
    model_->to(device);
  }
  Tensor tokens(const Tensor& images) override {
    const Tensor here = nn::to_device(images, device_).to(nn::dtype_of(model_->parameters().front()));
    const Tensor others = flow_.encoder ? flow_tokens(here) : Tensor();
    return model_->forward(here, estimator_.is_empty() ? PictureEstimate() : estimated(here), others);
  }
  std::optional<Tensor> cameras(const Tensor& images) override {
    if (estimator_.is_empty()) return std::nullopt;
    return estimated(images.to(device_, torch::kFloat32)).camera;
  }
  std::optional<nn::NamedModel> trained() const override { return nn::NamedModel{kEncoderName, model_.ptr()}; }
  std::unique_ptr<ConditionEncoder> replica() const override {
    auto twin =
        std::make_unique<TrainedPatches>(model_->options(), estimator_, flow_, channels_, device_, nn::Init::kNone);
    nn::load_state_dict(*twin->model_, nn::state_dict(*model_), nn::LoadMode::kStrict);
    return twin;
  }

 private:
  PictureEstimate estimated(const Tensor& images) {
    const torch::NoGradGuard no_grad;
    const std::int64_t size = estimator_->options().image_size;
    return estimator_->forward(
        images.size(2) == size ? images : torch::upsample_bilinear2d(images, {size, size}, /*align_corners=*/false));
  }

  Tensor flow_tokens(const Tensor& images) {
    const torch::NoGradGuard no_grad;
    return flow_.encoder->tokens(images);
  }

  PatchImageEncoder model_;
  PictureEstimator estimator_;
  FlowTokens flow_;
  std::int64_t channels_;
  torch::Device device_;
};

/// A flow's config, and cond_channels of its model.
struct FlowConfig {
  nn::RunModel flow;
  std::int64_t channels = 0;
};

/// @param may_see_flow its encoder may itself see the tokens of a flow
/// @throws InputError naming the config: no model with cond_channels, or an encoder that may not
FlowConfig flow_config_of(const std::filesystem::path& run, bool may_see_flow) {
  FlowConfig found;
  found.flow.config = run / "config.json";
  found.flow.run = read_json(found.flow.config);
  const Json::json_pointer nested("/trainer/args/image_encoder/flow");
  if (!may_see_flow && found.flow.run.contains(nested))
    throw InputError(found.flow.config.string(), nested.to_string(), "this encoder sees another flow's tokens itself");
  const Json models = found.flow.run.value("models", Json::object());
  for (const Json& model : models) {
    const Json::json_pointer width("/args/cond_channels");
    if (model.contains(width) && model.at(width).is_number_integer()) found.channels = model.at(width);
  }
  if (found.channels < 1) throw InputError(found.flow.config.string(), "/models", "no model of it has cond_channels");
  return found;
}

/// @param run folder of the other flow @throws InputError naming its config: no model with cond_channels, or an encoder
/// that itself sees the tokens of a flow
FlowTokens flow_tokens_of(const std::filesystem::path& run, std::int64_t image_size, torch::Device device) {
  const FlowConfig found = flow_config_of(run, /*may_see_flow=*/false);
  FlowTokens tokens;
  tokens.channels = found.channels;
  tokens.encoder = trained_condition_encoder(run, found.flow, image_size, tokens.channels, device);
  return tokens;
}

/// @param reader, key where the name stands, for messages
std::unique_ptr<ConditionEncoder> make_dinov2(const ConfigReader& reader, const char* key, const std::string& name,
                                              const std::filesystem::path& weights, std::int64_t image_size,
                                              std::int64_t channels, torch::Device device) {
  const auto options = Dinov2Options::named(name);
  if (options.embed_dim != channels) {
    throw reader.error(key, "its tokens have " + std::to_string(options.embed_dim) +
                                " channels, the flow's cond_channels are " + std::to_string(channels));
  }
  if (image_size % options.patch_size != 0) {
    throw reader.error(key, "its patches of " + std::to_string(options.patch_size) +
                                " pixels do not divide the dataset's image_size, " + std::to_string(image_size));
  }
  Dinov2 model(options);
  load_dinov2_weights(model, weights);
  model->to(device);
  return std::make_unique<FrozenDinov2>(model);
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

Tensor image_condition(Dinov2& model, const Tensor& images) {
  const torch::NoGradGuard no_grad;
  const Tensor any_weight = model->parameters().front();
  const Tensor here = nn::to_device(images, any_weight.device()).to(nn::dtype_of(any_weight));
  const Tensor tokens = model->tokens_after(imagenet_normalized(here), model->options().depth);
  return nn::layer_norm(tokens, kConditionEps);
}

Tensor null_condition(const Tensor& condition) { return torch::zeros_like(condition); }

void read_condition_arguments(ConfigReader& trainer_args) {
  trainer_args.text(kModelName, kPublishedModel);
  if (trainer_args.has(kEncoderName)) trainer_args.object(kEncoderName);
}

std::unique_ptr<ConditionEncoder> make_condition_encoder(ConfigReader& trainer_args, std::int64_t image_size,
                                                         std::int64_t channels, torch::Device device,
                                                         const std::filesystem::path& run) {
  const std::string published_model = trainer_args.text(kModelName, kPublishedModel);
  if (!trainer_args.has(kEncoderName)) {
    const std::optional<std::filesystem::path> weights = published_weights(published_model);
    if (!weights) {
      throw trainer_args.error(
          kEncoderName, std::string("says what turns pictures into conditions; without it the weights of DINOv2 "
                                    "must lie in ") +
                            kPublishedFolder + "/" + Dinov2Options::published_file_stem(published_model) +
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
  const auto options = PatchImageEncoderOptions::from_json(*trainer_args.raw(kEncoderName), encoder.file(),
                                                           trainer_args.pointer_to(kEncoderName));
  if (options.image_size != image_size) {
    throw encoder.error("image_size", "is " + std::to_string(options.image_size) + ", the dataset's image_size is " +
                                          std::to_string(image_size));
  }
  const auto named = [&](const std::string& name, const char* key) {
    return nn::named_run(run.empty() ? std::filesystem::current_path() : run, name, encoder.file(),
                         trainer_args.pointer_to(kEncoderName) + "/" + key);
  };
  PictureEstimator estimator = nullptr;
  if (!options.estimator.empty()) {
    const std::filesystem::path trained = named(options.estimator, "estimator");
    const nn::RunModel found = nn::find_run_model(trained, kPictureEstimatorClass);
    log::info("normals, coordinates and cameras of pictures are estimated by {}", found.checkpoint.string());
    estimator = nn::load_trained<PictureEstimator>(found, device);
  }
  FlowTokens flow;
  if (!options.flow.empty()) {
    const std::filesystem::path other = named(options.flow, "flow");
    flow = flow_tokens_of(other, image_size, device);
    log::info("the image encoder of {} gives its tokens, too", other.string());
  }
  return std::make_unique<TrainedPatches>(options, std::move(estimator), std::move(flow), channels, device,
                                          nn::Init::kPublished);
}

std::unique_ptr<ConditionEncoder> trained_condition_encoder(const std::filesystem::path& run, const nn::RunModel& flow,
                                                            std::int64_t image_size, std::int64_t channels,
                                                            torch::Device device) {
  ConfigReader top(flow.run, flow.config.string());
  ConfigReader trainer_args = top.object("trainer").object("args");
  auto encoder = make_condition_encoder(trainer_args, image_size, channels, device, run);
  const std::optional<nn::NamedModel> trained = encoder->trained();
  if (!trained) return encoder;
  const std::filesystem::path weights = nn::newest_checkpoint(run, trained->name);
  nn::load_state_dict(*trained->module, io::read_state_dict(weights), nn::LoadMode::kStrict, weights.string());
  trained->module->eval();
  return encoder;
}

FlowEncoder flow_encoder_of(const std::filesystem::path& run, torch::Device device) {
  const FlowConfig found = flow_config_of(run, /*may_see_flow=*/true);
  FlowEncoder flow;
  flow.channels = found.channels;
  const Json::json_pointer size("/dataset/args/image_size");
  if (found.flow.run.contains(size)) {
    const Json& value = found.flow.run.at(size);
    if (!value.is_number_integer() || value < 1 || value > 4096)
      throw InputError(found.flow.config.string(), size.to_string(), "must be a whole number from 1 to 4096");
    flow.image_size = value;
  }
  flow.encoder = trained_condition_encoder(run, found.flow, flow.image_size, flow.channels, device);
  return flow;
}

}  // namespace anigen::vision
