#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models::rignet {

using torch::Tensor;

/// How joints come out of displaced vertices; defaults are published (reference anymate-baselines.md, 9.3).
struct JointClusters {
  double bandwidth = 0.04;        ///< in units of the longest side
  double least_attention = 1e-3;  ///< vertices must attend by more
  double least_density = 1e-5;    ///< of a place, in shares of the sum over all places
  std::int64_t most_shifts = 40;
  double least_movement = 1e-3;  ///< of all points together: less is the end
  bool mirrored = true;          ///< points count on both sides of x = 0, and so do joints
  double middle = 0.02;          ///< joints this near to x = 0 lie on it, when mirrored
};

/// Joints of one mesh: displaced vertices inside it that attend enough, and their mirror images, go to where they are
/// densest (mean_shifted, whole steps, as training's damped ones end there too); of places within a bandwidth only the
/// densest stays. Mirrored, those near the middle go onto it and those on the side x > 0 get a twin. While fewer than
/// two joints are left and there are sparser places, the least density goes down by a factor of 1.3. Where no displaced
/// vertex is inside, all count; where none attends, all of those left.
/// @param points [V, 3] @param attention [V] in [0, 1] @param inside [V] bool: whether a displaced vertex is inside
/// @return [J, 3] fp32 on the CPU, at least one @throws InputError for shapes, without points or not finite
Tensor clustered_joints(const Tensor& points, const Tensor& attention, const Tensor& inside,
                        const JointClusters& options = {});

}  // namespace anigen::models::rignet
