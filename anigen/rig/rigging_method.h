#pragma once
#include <optional>
#include <string>
#include <vector>

#include "anigen/rig/binding/binding.h"

namespace anigen::rig {

/// Where the joints of a mesh come from.
enum class JointSource {
  kGiven,     ///< the mesh's own file, or another one
  kTemplate,  ///< the middle skeleton of a collection, by bounding box (medoid())
  kCurve,     ///< the curve that the mesh contracts to (propose_curve_skeleton())
  kPinocchio  ///< a template embedded in the mesh (choose_template())
};

/// What makes a rig of a mesh without having learned anything.
struct RiggingMethod {
  JointSource joints = JointSource::kGiven;
  std::optional<SkinBinding> binding = SkinBinding::kGeodesicVoxels;  ///< nothing: joints only
};

/// "nearest", "geovoxel", "heat": that binding to given joints; "template": with the nearest bone, as a baseline that
/// looks at nothing; "curve": with geodesic voxels; "pinocchio": with heat, as published.
/// @param skin "": as above; "none": joints only; or the word of a binding
/// @throws InputError for another word, naming all of them
RiggingMethod parse_rigging_method(const std::string& method, const std::string& skin = "");
std::vector<std::string> rigging_method_words();

}  // namespace anigen::rig
