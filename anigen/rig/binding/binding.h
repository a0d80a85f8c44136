#pragma once
#include <string>

#include "anigen/rig/binding/bind_nearest.h"
#include "anigen/rig/binding/bone_heat.h"
#include "anigen/rig/binding/geodesic_voxel.h"

namespace anigen::rig {

/// Ways to bind a mesh to a skeleton without having learned any.
enum class SkinBinding {
  kNearest,         ///< "nearest": bind_to_nearest_bone()
  kGeodesicVoxels,  ///< "geovoxel": bind_by_geodesic_voxels()
  kHeat             ///< "heat": bind_by_heat()
};

std::string to_string(SkinBinding binding);
/// @throws InputError for another word, naming all of them
SkinBinding parse_skin_binding(const std::string& word);

struct BindingOptions {
  GeodesicVoxelOptions geodesic;
  BoneHeatOptions heat;
};

/// Skin weights for a mesh in the bind pose of a skeleton: one row per vertex, each summing to 1. Normals, textures and
/// weights that the mesh had do not matter. @throws InputError as the function of that binding
SkinWeights bind(SkinBinding binding, const Mesh& mesh, const Skeleton& skeleton, const BindingOptions& options = {});

}  // namespace anigen::rig
