#pragma once
#include "anigen/nn/torch.h"

namespace anigen::features {

/// What estimates the surface normals that a picture shows (reference flows-and-pipeline.md, 5.4).
class NormalEstimator {
 public:
  virtual ~NormalEstimator() = default;

  /// @param rgb [1, 3, H, W] fp32 in [0, 1]: the whole picture, neither cropped nor resized, its background still there
  /// @return [1, 3, H, W] fp32, of unit length; camera frame: X right, Y down, Z forward, pointing away from the camera
  /// (a wall that faces the camera is (0, 0, 1))
  /// @throws InputError when the picture is larger than the estimator can hold
  virtual torch::Tensor normals(const torch::Tensor& rgb) = 0;
};

}  // namespace anigen::features
