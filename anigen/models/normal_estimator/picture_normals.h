#pragma once
#include "anigen/models/normal_estimator/dsine.h"

namespace anigen::models {

/// Zeros around a picture that make height and width multiples of 32, as evenly as whole pixels allow.
struct PicturePadding {
  std::int64_t left = 0, right = 0, top = 0, bottom = 0;
};
PicturePadding dsine_padding(std::int64_t height, std::int64_t width);

/// The normals of a picture as the published pipeline asks DSINE for them (reference normal-estimator.md, 3): black
/// around the picture before ImageNet's normalisation, a camera of 60° across the longer side of the picture without
/// padding, the padding cut off again.
/// @param rgb [B, 3, H, W] in [0, 1], converted to dtype and device of the network
/// @return [B, 3, H, W] unit normals, pointing away from the camera: X right, Y down, Z forward
Tensor picture_normals(Dsine& network, const Tensor& rgb, int iterations = kDsineIterations);

}  // namespace anigen::models
