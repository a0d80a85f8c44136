#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/config_fields.h"
#include "anigen/nn/blocks.h"
#include "anigen/nn/init.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/torch.h"

namespace anigen::vision {

using torch::Tensor;

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
struct PictureEstimatorOptions : JsonOptions<PictureEstimatorOptions> {
  std::int64_t image_size = 128;  ///< pixels on a side, a multiple of 16
  std::int64_t width = 192;       ///< channels of the blocks, at a sixteenth of the size; a multiple of 64
  std::int64_t num_blocks = 4;
  std::int64_t num_heads = 6;
  double mlp_ratio = 4.0;
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

/// Normals, canonical coordinates (Wang et al. 2019, "NOCS"), family and camera of the object in a condition picture: a
/// U-Net of convolutions whose lowest level is a transformer over patches of 16 pixels. Maps mean nothing where the
/// object is not. Always fp32.
class PictureEstimatorImpl : public torch::nn::Module {
 public:
  explicit PictureEstimatorImpl(const PictureEstimatorOptions& options, nn::Init init = nn::Init::kPublished);

  /// @param images [B, 3, S, S] fp32 in [0, 1], on black @throws InputError on another shape
  PictureEstimate forward(const Tensor& images);

  const PictureEstimatorOptions& options() const { return options_; }

 private:
  PictureEstimatorOptions options_;
  std::vector<torch::nn::Conv2d> down_, refine_, across_, up_;  // by level, fine to coarse
  std::vector<nn::TransformerBlock> blocks_;
  torch::nn::Conv2d maps_ = nullptr;
  nn::Linear whole_ = nullptr;
  Tensor pos_emb_;
};
TORCH_MODULE(PictureEstimator);

}  // namespace anigen::vision
