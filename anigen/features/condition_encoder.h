#pragma once
#include <memory>
#include <optional>
#include <string>

#include "anigen/core/config_reader.h"
#include "anigen/nn/named_model.h"
#include "anigen/nn/torch.h"

namespace anigen::features {

using torch::Tensor;

/// Turns condition pictures into the tokens a flow model attends to.
class ConditionEncoder {
 public:
  virtual ~ConditionEncoder() = default;

  /// @param images [B, 3, S, S] in [0, 1], anywhere @return [B, M, C] on the encoder's device
  virtual Tensor tokens(const Tensor& images) = 0;
  /// What is trained together with the flow, and saved beside it; none for a frozen encoder.
  virtual std::optional<nn::NamedModel> trained() const { return std::nullopt; }
  /// One with parameters of its own, of the same values, over the same frozen weights.
  virtual std::unique_ptr<ConditionEncoder> replica() const = 0;
};

/// The trainer argument `image_encoder` (ours; the published trainer has DINOv2 built in):
///
/// - `{"name": "dinov2", "weights": FILE}`, with `model` (default: the published argument
///   `image_cond_model`, itself "dinov2_vitl14_reg" by default): the published condition, frozen
///   (features/image_condition.h). Also what an absent argument means, as in the published configs, if the published
///   file lies in ckpts/dinov2 of the working directory: dinov2_vitl14_reg4_pretrain.pth for "dinov2_vitl14_reg", or
///   the same as .safetensors;
/// - `{"name": "patch", ...}`: a small encoder trained with the flow (models/patch_image_encoder.h), saved as
///   "image_encoder".
///
/// @param image_size of the dataset's condition pictures @param channels cond_channels of the flow model
/// @throws InputError naming the key: no encoder, weights that cannot be read, sizes that do not fit
std::unique_ptr<ConditionEncoder> make_condition_encoder(ConfigReader& trainer_args, std::int64_t image_size,
                                                         std::int64_t channels, torch::Device device);

}  // namespace anigen::features
