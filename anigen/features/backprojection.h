#pragma once
#include "anigen/nn/torch.h"

namespace anigen::features {

using torch::Tensor;

/// Where points appear in views: uv = π(K (E p)), scaled from [0, 1] to [-1, 1]; (-1, -1) is the top left corner of the
/// picture (reference training-and-data.md, 1.1, "Back-projection formula").
/// @param points [N, 3], world frame @param extrinsics [V, 4, 4] world → camera (OpenCV)
/// @param intrinsics [V, 3, 3] for a picture of width and height 1 @return [V, N, 2]; points in the plane of the eye
///   give values that are not finite
Tensor project_points(const Tensor& points, const Tensor& extrinsics, const Tensor& intrinsics);

/// The patch features that points see: bilinear between patch centres, zero outside the picture; neither occlusion nor
/// the side of the camera is tested, as published.
/// @param patches [V, rows·columns, C], row by row @param uv [V, N, 2] of project_points
/// @return [V, N, C]
Tensor sample_patches(const Tensor& patches, std::int64_t rows, std::int64_t columns, const Tensor& uv);

/// The plain mean over all views, those that show nothing included. Views are added one by one, in fp32, so the result
/// does not depend on how they were batched.
class ViewMean {
 public:
  /// @param per_view [V, N, C]
  void add(const Tensor& per_view);
  std::int64_t views() const { return views_; }
  /// [N, C] fp32. At least one view must have been added.
  Tensor mean() const;

 private:
  Tensor sum_;
  std::int64_t views_ = 0;
};

}  // namespace anigen::features
