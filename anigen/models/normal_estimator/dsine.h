#pragma once
#include "anigen/models/normal_estimator/camera_rays.h"
#include "anigen/models/normal_estimator/conv_gru.h"
#include "anigen/models/normal_estimator/normal_decoder.h"

namespace anigen::models {

inline constexpr int kDsineIterations = 5;                 ///< refinements, as published
inline constexpr std::int64_t kDsinePictureMultiple = 32;  ///< of height and width of what the network sees

/// What the refinement works on, at an eighth of the size: h = H / 8, w = W / 8.
struct DsineState {
  PinholeCamera camera;  ///< of this grid
  Tensor slopes, rays;   ///< [B, 2, h, w], [1, 3, h, w] unit: through the pixels of the grid
  Tensor input;          ///< [B, 66, h, w], features and slopes: the same in every iteration
  Tensor hidden;         ///< [B, 64, h, w]
  Tensor normals;        ///< [B, 3, h, w], unit
};

/// DSINE (Bae and Davison 2024, "Rethinking Inductive Biases for Surface Normal Estimation"; reference
/// normal-estimator.md): an encoder, a decoder, and a recurrent unit that refines normals at an eighth of the size by
/// turning those of neighbouring pixels. Evaluation only, under torch::NoGradGuard; fp32, or fp64 after to(kFloat64).
///
/// 72.6 million parameters in 570 tensors, and 348 buffers. Keys as released: `encoder.original_model.*`, `decoder.*`,
/// `gru.*`, `prob_head.*`, `xy_head.*`, `angle_head.*`, `up_prob_head.*`. The constructor reserves memory and writes
/// nothing but the affine maps of group norms: fill it with load_dsine (normal_estimator/dsine_weights.h).
class DsineImpl : public torch::nn::Module {
 public:
  DsineImpl();

  /// @param images [B, 3, H, W] in ImageNet's normalisation (imagenet_normalized), H and W multiples of 32
  /// @param camera of these pictures, padding included
  /// @param iterations refinements; 0: what the decoder says, upsampled
  /// @return [B, 3, H, W] unit normals, pointing away from the camera: X right, Y down, Z forward
  Tensor forward(const Tensor& images, const PinholeCamera& camera, int iterations = kDsineIterations);

  /// The steps of forward.
  EncoderMaps encode(const Tensor& images);
  /// @param camera of the pictures that were encoded
  DsineState begin(const EncoderMaps& maps, const PinholeCamera& camera);
  void refine(DsineState& state);
  /// @return [B, 3, H, W] unit normals
  Tensor upsampled(const DsineState& state);

 private:
  EfficientNetB5 encoder_ = nullptr;
  NormalDecoder decoder_ = nullptr;
  ConvGru gru_ = nullptr;
  PredictionHead prob_head_ = nullptr, xy_head_ = nullptr, angle_head_ = nullptr, up_prob_head_ = nullptr;
};
TORCH_MODULE(Dsine);

}  // namespace anigen::models
