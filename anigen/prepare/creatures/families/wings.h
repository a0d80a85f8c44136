#pragma once
#include "anigen/prepare/creatures/body.h"

namespace anigen::prepare {

struct WingShape {
  Eigen::Vector3d shoulder;
  double span, chord, radius, thickness;
  double sweep;  ///< how far the tip lies behind the shoulder, relative to the span
};

/// A feathered wing: three joints, a stiff vane behind each bone. @return its joints
std::vector<int> add_feathered_wing(Body& body, int parent, int side, const WingShape& shape, int bone, int feathers);

/// A bat's or dragon's wing: arm, forearm and fingers with skin stretched between them. @return its joints
std::vector<int> add_skin_wing(Body& body, int parent, int side, const WingShape& shape, int fingers, int bone,
                               int skin);

}  // namespace anigen::prepare
