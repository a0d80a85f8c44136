#pragma once
#include <cstdint>
#include <string>

#include "anigen/core/config_fields.h"
#include "anigen/nn/init.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/torch.h"
#include "anigen/vision/unet.h"

namespace anigen::vision {

inline constexpr const char* kPictureEstimatorClass = "PictureEstimator";

/// Columns of a camera of part of a picture as a row of numbers (render::PartCamera): sine and cosine of yaw, pitch,
/// logarithm of scale, shift_x, shift_y, nearness.
inline constexpr std::int64_t kCameraNumbers = 7;

/// Points of the object's frame in pictures. @param cameras [B, 7] @param points [N, 3]
/// @return [B, N, 3]: u and v in [0, 1]² from the upper left corner, and the distance from the plane through the
/// origin that faces the camera, positive towards it. Sine and cosine need not have length 1; 1 − nearness c counts as
/// 0.1 at least, so that a bad estimate of a camera puts no point behind it.
Tensor seen_from(const Tensor& cameras, const Tensor& points);

/// Arguments of the picture estimator, a model of ours.
struct PictureEstimatorOptions : UNetOptions, JsonOptions<PictureEstimatorOptions> {
  std::int64_t families = 0;  ///< kinds of objects that are told apart; 0: none

  void fields(ConfigFields& f);
  void validate(const std::string& file = "", const std::string& pointer = "") const;
};

/// Estimates about pictures, maps at half their size.
struct PictureEstimate {
  Tensor normals;      ///< [B, 3, S/2, S/2] unit vectors in the camera's frame: x right, y up, z to the viewer
  Tensor coordinates;  ///< [B, 3, S/2, S/2] place on the surface in the object's frame
  Tensor family;       ///< [B, families] logits
  Tensor camera;       ///< [B, 7], see kCameraNumbers
};

/// Normals, canonical coordinates (Wang et al. 2019, "NOCS"), family and camera of the object in a condition picture,
/// by a U-Net (vision/unet.h). Maps mean nothing where the object is not. Always fp32.
class PictureEstimatorImpl : public torch::nn::Module {
 public:
  explicit PictureEstimatorImpl(const PictureEstimatorOptions& options, nn::Init init = nn::Init::kPublished);

  /// @param images [B, 3, S, S] fp32 in [0, 1], on black @throws InputError on another shape
  PictureEstimate forward(const Tensor& images);

  const PictureEstimatorOptions& options() const { return options_; }

 private:
  PictureEstimatorOptions options_;
  UNet unet_ = nullptr;
  torch::nn::Conv2d maps_ = nullptr;
  nn::Linear whole_ = nullptr;
};
TORCH_MODULE(PictureEstimator);

}  // namespace anigen::vision
