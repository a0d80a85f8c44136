#pragma once
#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"

namespace anigen::rig {

/// Every vertex with weight 1 on the joint whose bones (geometry::bone_segments) are nearest by straight distance; the
/// lower index of equals. The baseline of all binding: neither smooth nor aware of the surface. Needs no faces.
/// @throws InputError naming a vertex or joint that is not finite, or without joints
SkinWeights bind_to_nearest_bone(const Mesh& mesh, const Skeleton& skeleton);

}  // namespace anigen::rig
