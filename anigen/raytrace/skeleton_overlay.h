#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/io/image.h"
#include "anigen/raytrace/camera.h"

namespace anigen::raytrace {

struct OverlayStyle {
  Eigen::Vector3f bone{1.0f, 0.62f, 0.16f};  ///< sRGB
  Eigen::Vector3f joint{1.0f, 0.97f, 0.90f};
  Eigen::Vector3f outline{0.10f, 0.11f, 0.14f};
  bool color_by_joint = false;  ///< bones in the colours that weight pictures give their child joints
  double thickness = 1.0;       ///< factor on the sizes, which follow the picture's
};

/// Draws bones as tapered capsules, thick at the parent, and joints as dots, over the picture: anti-aliased, with a
/// dark rim so that they show on light and on dark; far ones first. Joints behind the camera are left out.
/// @param positions,parents [J] world frame; parent -1 for a root
/// @param shown [J], or empty for all: joints that are not shown are left out and bones go on to the next ancestor
/// @throws InputError when lengths differ, a parent is out of range or a position is not finite
void draw_skeleton(io::Image& image, const Camera& camera, const std::vector<Eigen::Vector3d>& positions,
                   const std::vector<int>& parents, const OverlayStyle& style = {},
                   const std::vector<bool>& shown = {});

}  // namespace anigen::raytrace
