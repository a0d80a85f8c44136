#pragma once
#include <string>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"
#include "anigen/core/job.h"

namespace anigen::studio {

/// Joints as the page sends them, as a skeleton without orientations, parents first.
/// @param joints list of {"name", "parent": place in the list or −1, "position": [x, y, z]} in glTF's frame, Y up, as
/// in the files of a job; in any order @throws InputError with the JSON pointer: no joint or more than 1000, a name
/// that is empty, longer than 200 bytes or twice there, no or several roots, a cycle, a position that is not finite
Skeleton skeleton_of_joints(const Json& joints);

struct Rebound {
  Asset asset;
  double milliseconds = 0.0;  ///< of binding alone
};

/// The asset's mesh on other joints, with new skin weights; its clips are dropped, since they belong to the old joints.
/// @param binding heat, geovoxel or nearest @throws InputError as engine::rig(); Interrupted
Rebound rebound(const Asset& asset, const Skeleton& skeleton, const std::string& binding, Job* job = nullptr);

}  // namespace anigen::studio
