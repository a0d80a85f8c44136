#pragma once
#include <Eigen/Core>

#include "anigen/asset/asset.h"

namespace anigen {

/// x → scale · x + offset.
struct Similarity {
  double scale = 1.0;
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
};

/// Applies the similarity to mesh, bind pose, rest pose and animations alike. Joint orientations and joint scales
/// stay as they are: translations carry the change.
void apply(const Similarity& similarity, Asset& asset);

/// Puts the mesh's bounding box into [-0.5, 0.5]³: centre at the origin, longest side 1 (reference
/// training-and-data.md, section 1.1). @return what was applied
/// @throws InputError when the box is empty, not finite, or has no extent
Similarity normalize(Asset& asset);

}  // namespace anigen
