#pragma once
#include <string>

#include "anigen/io/image.h"
#include "anigen/models/dinov2.h"

namespace anigen::features {

using torch::Tensor;

inline constexpr int kConditionSize = 518;  ///< pixels on a side of every picture that DINOv2 sees

/// A condition picture as training prepares it: cropped to io::condition_box, RGBA Lanczos to size × size, on black
/// (reference training-and-data.md, 1.4, "Condition image"). @return [3, size, size] fp32 in [0, 1]
/// @throws InputError naming `name` when no pixel is visible
Tensor condition_image(const io::Image& image, int size = kConditionSize, const std::string& name = "");

/// A picture with alpha as generation prepares it: cropped to io::inference_box, resized, put on black and rounded down
/// to bytes (reference flows-and-pipeline.md, 5.2, steps 3 and 4). Opaque.
io::Image inference_image(const io::Image& image, int size = kConditionSize, const std::string& name = "");

/// A view as feature extraction prepares it: the whole picture, RGBA Lanczos, on black (reference
/// training-and-data.md, 1.1, features). @return [3, size, size] fp32 in [0, 1]
Tensor view_image(const io::Image& image, int size = kConditionSize);

/// Planes [3, H, W] of an opaque picture, alpha dropped, fp32 in [0, 1].
Tensor color_tensor(const io::Image& image);

/// What the flow models are conditioned on: all tokens of DINOv2 before its final norm, through a layer norm without
/// parameters and with eps 1e-5 (reference flows-and-pipeline.md, 5.3). Gradients are not recorded.
/// @param images [B, 3, H, W] in [0, 1], anywhere; they are moved to the model's device
/// @return [B, 1 + R + P, C] on the model's device
Tensor image_condition(models::Dinov2& model, const Tensor& images);

/// The condition of no picture: zeros of the same shape.
Tensor null_condition(const Tensor& condition);

}  // namespace anigen::features
