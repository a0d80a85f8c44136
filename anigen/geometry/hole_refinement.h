#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {

/// Triangles that close a hole.
struct HolePatch {
  std::vector<Eigen::Vector3d> points;  ///< those of the outline first, in its order
  std::vector<Triangle> faces;
  std::int32_t outline = 0;  ///< how many points belong to the outline
};

/// Gives a patch triangles of about the size of those around it: adds points in the middle of large triangles and turns
/// edges towards larger angles, until neither has anything to do (Liepa 2003, section 4). The outline stays.
/// @param scale how long edges should be at each of the patch's points: the mean of the surface around it
/// @param may_connect whether an edge between two points of the outline may be made
void refine_patch(HolePatch& patch, std::vector<double> scale,
                  const std::function<bool(std::int32_t, std::int32_t)>& may_connect);

}  // namespace anigen::geometry
