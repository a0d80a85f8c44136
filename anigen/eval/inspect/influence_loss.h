#pragma once
#include <cstddef>

#include "anigen/asset/asset.h"
#include "anigen/core/json.h"

namespace anigen::eval {

/// What is lost when only the `influences` heaviest joints of every vertex are kept, as exporters do.
struct InfluenceLoss {
  std::size_t influences = 4;
  std::size_t affected = 0;  ///< vertices with more influences
  double mean_l1 = 0;        ///< Σ_j |w' − w| averaged over all vertices
  double max_l1 = 0;
  std::size_t frames = 0;       ///< sampled poses, over all animations
  double max_displacement = 0;  ///< of any vertex in any of them, as a part of the mesh's bounding box diagonal
};

/// @param frames_per_animation poses at equal times from the start to the end of each animation
InfluenceLoss influence_loss(const Asset& asset, std::size_t influences, std::size_t frames_per_animation = 16);

Json to_json(const InfluenceLoss& loss);

}  // namespace anigen::eval
