#pragma once
#include <vector>

#include "anigen/fields/skeleton_field.h"
#include "anigen/models/structured_latent_options.h"
#include "anigen/sparse/sparse_tensor.h"

namespace anigen::models {

/// Channels of the skeleton heads of the decoder: joint 3, parent 3, their confidences 1 and 1, that of the skin
/// feature 1, the skin feature S; each of the fields eight times, corner by corner, when it stands on corners
/// (reference autoencoders.md, 3.6).
struct SkeletonHeadLayout {
  std::int64_t resolution = 0;  ///< of the voxels of the field
  std::int64_t skin_channels = 0;
  bool joint_confidence = false, skin_confidence = false, on_center = true;
  bool residual = true;    ///< joints and parents relative to the position
  bool continuous = true;  ///< confidences through a sigmoid; the joint's also serves the skin feature

  explicit SkeletonHeadLayout(const StructuredLatentDecoderOptions& options);
  /// Without the skin feature, and of it.
  std::int64_t joint_channels() const;
  std::int64_t skin_feature_channels() const { return skin_channels * (on_center ? 1 : 8); }
};

/// The fields of every asset, activated. On corners, values are first averaged over the voxels that touch a grid
/// vertex, in the order x, y, z of the vertices; a vertex v stands at (v + 0.5)/R − 0.5, as published.
/// @param raw joint_channels() + skin_feature_channels() channels @throws InputError for another number of channels
std::vector<fields::SkeletonField> skeleton_fields(const sparse::SparseTensor& raw, const SkeletonHeadLayout& layout);

}  // namespace anigen::models
