#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "anigen/core/config.h"
#include "anigen/io/image.h"
#include "anigen/nn/state_dict.h"
#include "anigen/nn/torch.h"
#include "anigen/nn/trainable.h"
#include "anigen/vision/dinov2.h"

namespace anigen::vision {

inline constexpr int kConditionSize = 518;  ///< pixels on a side of every picture that DINOv2 sees

/// A condition picture as training prepares it: cropped to io::condition_box, RGBA Lanczos to size × size, on black
/// (docs/reference/training.md, 1.3). @return [3, size, size] fp32 in [0, 1]
/// @throws InputError naming `name` when no pixel is visible
Tensor condition_image(const io::Image& image, int size = kConditionSize, const std::string& name = "");

/// A picture with alpha as generation prepares it: cropped to io::inference_box, resized, put on black and rounded down
/// to bytes (docs/reference/flows.md, 5.2). Opaque.
io::Image inference_image(const io::Image& image, int size = kConditionSize, const std::string& name = "");

/// A view as feature extraction prepares it: the whole picture, RGBA Lanczos, on black (docs/reference/training.md,
/// 1.1). @return [3, size, size] fp32 in [0, 1]
Tensor view_image(const io::Image& image, int size = kConditionSize);

/// Planes [3, H, W] of an opaque picture, alpha dropped, fp32 in [0, 1].
Tensor color_tensor(const io::Image& image);

/// Condition of the flow models: all tokens of DINOv2 before its final norm, through a layer norm without
/// parameters and with eps 1e-5 (docs/reference/flows.md, 5.3). Gradients are not recorded.
/// @param images [B, 3, H, W] in [0, 1], anywhere; they are moved to the model's device
/// @return [B, 1 + R + P, C] on the model's device
Tensor image_condition(Dinov2& model, const Tensor& images);

/// The condition of no picture: zeros of the same shape.
Tensor null_condition(const Tensor& condition);

/// Turns condition pictures into the tokens a flow model attends to.
class ConditionEncoder {
 public:
  virtual ~ConditionEncoder() = default;

  /// @param images [B, 3, S, S] in [0, 1], anywhere @return [B, M, C] on the encoder's device
  virtual Tensor tokens(const Tensor& images) = 0;
  /// Cameras of the pictures, [B, 7] as vision/picture_estimator.h has them; nothing from an encoder that knows none.
  virtual std::optional<Tensor> cameras(const Tensor& images) {
    static_cast<void>(images);
    return std::nullopt;
  }
  /// Model trained together with the flow, and saved beside it; none for a frozen encoder.
  virtual std::optional<nn::NamedModel> trained() const { return std::nullopt; }
  /// One with parameters of its own, of the same values, over the same frozen weights.
  virtual std::unique_ptr<ConditionEncoder> replica() const = 0;
};

/// The trainer argument `image_encoder` (ours; the published trainer has DINOv2 built in):
///
/// - `{"name": "dinov2", "weights": FILE}`, with `model` (default: the published argument
///   `image_cond_model`, itself "dinov2_vitl14_reg" by default): the published condition, frozen
///   (vision/condition.h). Also what an absent argument means, as in the published configs, if the published
///   file lies in ckpts/dinov2 of the working directory: dinov2_vitl14_reg4_pretrain.pth for "dinov2_vitl14_reg", or
///   the same as .safetensors;
/// - `{"name": "patch", ...}`: a small encoder trained with the flow (vision/patch_encoder.h), saved as
///   "image_encoder"; with `estimator` it sees what a picture estimator, frozen, says of the picture, and with `flow`
///   tokens of another flow's image encoder, frozen, join its own.
///
/// @param image_size of the dataset's condition pictures @param channels cond_channels of the flow model
/// @param run folder of a trained flow, where a picture estimator is looked for, too, as nn::named_run(); or empty
/// @throws InputError naming the key: no encoder, weights that cannot be read, sizes that do not fit
std::unique_ptr<ConditionEncoder> make_condition_encoder(ConfigReader& trainer_args, std::int64_t image_size,
                                                         std::int64_t channels, torch::Device device,
                                                         const std::filesystem::path& run = {});

/// Reads the names of the encoder's arguments alone: a config is described (anigen-train --schema) without a dataset.
void read_condition_arguments(ConfigReader& trainer_args);

/// Encoder of images for a trained flow: its run's `image_encoder`, with the newest weights it was trained
/// to beside the flow where it was trained; otherwise frozen DINOv2.
/// @param run folder of the flow @param flow found in it; the other arguments as make_condition_encoder
/// @throws InputError when the encoder or its weights are missing or do not fit
std::unique_ptr<ConditionEncoder> trained_condition_encoder(const std::filesystem::path& run, const nn::RunModel& flow,
                                                            std::int64_t image_size, std::int64_t channels,
                                                            torch::Device device);

/// The image encoder of a flow, whatever stage it is of.
struct FlowEncoder {
  std::unique_ptr<ConditionEncoder> encoder;
  std::int64_t image_size = kConditionSize;  ///< of the dataset that the flow was trained on
  std::int64_t channels = 0;                 ///< of its tokens
};
/// @param run folder of the flow @throws InputError naming its config: no model with cond_channels, or as
/// trained_condition_encoder()
FlowEncoder flow_encoder_of(const std::filesystem::path& run, torch::Device device);

}  // namespace anigen::vision
