#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/rig/embedding/embedding_template.h"

namespace anigen::rig {

/// Places the carried joints of a template with those they hang on: turned and scaled like the bone that leads there
/// from its parent, where there is one, else moved only. Joints above the first that is not carried move with it.
/// @param skeleton positions in the frame of the joints @param joints [J], those that are not carried in place
void place_carried_joints(const TemplateSkeleton& skeleton, std::vector<Eigen::Vector3d>& joints);

}  // namespace anigen::rig
