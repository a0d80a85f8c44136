#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"

namespace anigen::studio {

/// One touch of a brush that paints skin weights. A vertex at distance d < radius from the centre, in the bind pose, is
/// changed by a = strength · (1 − (d / radius)²)².
struct Stroke {
  enum class Mode {
    kAdd,     ///< w ← (1 − a) w, and a more for the joint
    kRemove,  ///< the joint loses the share a of its weight to the others of the vertex, without any to its parent
    kSmooth,  ///< w ← (1 − a) w + a · mean over the neighbours of w, of all joints
  };
  int joint = 0;  ///< of kAdd and kRemove
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  double radius = 0.0, strength = 1.0;
  Mode mode = Mode::kAdd;
};

/// Strokes as the page sends them: a list of {"joint": name, "center": [x, y, z], "radius", "strength", "mode":
/// "add|remove|smooth"}, in glTF's frame. @throws InputError with the JSON pointer
std::vector<Stroke> parse_strokes(const Json& strokes, const Skeleton& skeleton);

/// Changes the skin weights by one stroke after the other. Vertices at one place, split at seams, count as one
/// neighbour. In the end a vertex keeps its 4 heaviest joints, or as many as one had before where that is more.
/// @pre one row of weights per vertex
void apply_strokes(const std::vector<Stroke>& strokes, Asset& asset);

}  // namespace anigen::studio
