#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"
#include "anigen/core/job.h"

namespace anigen::studio {

/// Joints as the page sends them, as a skeleton without orientations, parents first.
/// @param joints list of {"name", "parent": place in the list or −1, "position": [x, y, z]} in glTF's frame, Y up, as
/// in the files of a job, and perhaps "was"; in any order @throws InputError with the JSON pointer: no joint or more
/// than 1000, a name that is empty, longer than 200 bytes or twice there, no or several roots, a cycle, a position that
/// is not finite
Skeleton skeleton_of_joints(const Json& joints);

/// A position that a request gives in glTF's frame. @throws InputError at `key` unless it is three finite numbers
Eigen::Vector3d world_position(const std::vector<double>& values, const ConfigReader& reader, const std::string& key);

/// The skeleton of `joints` with the names that its joints had in the rig: "was" where a joint has another one now.
/// @throws InputError when a name was there twice
Skeleton with_former_names(Skeleton skeleton, const Json& joints);

/// Gives the joints of an asset their new names. @param names by joint of `former`, which has all of the asset's joints
void rename_joints(const Skeleton& former, const std::vector<std::string>& names, Asset& asset);

struct Rebound {
  Asset asset;
  double milliseconds = 0.0;  ///< of binding alone
};

/// The asset's mesh on other joints, with new skin weights; its clips are dropped, since they belong to the old joints.
/// @param binding heat, geovoxel or nearest @throws InputError as engine::rig(); Interrupted
Rebound rebound(const Asset& asset, const Skeleton& skeleton, const std::string& binding, Job* job = nullptr);

/// All joints of the skeleton have a namesake in the asset.
bool has_joints(const Asset& asset, const Skeleton& skeleton);

/// Likewise with the weights that the asset has, by the names of the joints. Those of a joint that the skeleton lacks
/// go to the nearest joint above it that it has. Clips and axes of the joints stay where the joints are the same.
/// @throws InputError naming a joint that the asset does not have
Rebound with_kept_weights(const Asset& asset, const Skeleton& skeleton);

}  // namespace anigen::studio
