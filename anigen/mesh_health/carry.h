#pragma once
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/mesh_health/repair.h"

namespace anigen::mesh_health {

/// An asset with another surface.
struct CarriedAsset {
  Asset asset;
  std::vector<std::string> lost;  ///< what the asset had and the new one has not, each as "texture coordinates"
};

/// The asset with a repaired surface. Faces that are as they were keep the texture coordinates, normals, colours,
/// material and skin weights of their corners, so that textures stay; new faces continue those of a neighbour. Vertices
/// are split again where corners of one vertex differ.
/// @param repaired by repair(from.mesh, options)
CarriedAsset carry_to_repaired(const Asset& from, const Repaired& repaired, const RepairOptions& options);

/// The asset with a new surface near the old one. Each vertex gets the skin weights of its nearest place
/// (geometry::matching_places), and its base colour there where the asset has colours, textures or several materials:
/// these become vertex colours, linear. Skeleton and animations stay, texture coordinates go, normals are made anew.
/// @throws InputError when a texture cannot be decoded
CarriedAsset carry_to_new_surface(const Asset& from, Mesh surface);

}  // namespace anigen::mesh_health
