#pragma once
#include <filesystem>

#include "anigen/asset/asset.h"
#include "anigen/fields/skeleton_field.h"

namespace anigen::pipeline {

enum class VotesShown { kJoints, kParents };

struct VotesCloudOptions {
  VotesShown shown = VotesShown::kJoints;  ///< with their own confidence each
  float least_confidence = 0.0F;           ///< votes below it are left out
  float radius = 0.002F;                   ///< of a vote drawn as an octahedron, object space (a voxel is 1/64 wide)
};

/// The votes of a skeleton field as points coloured by confidence (paper Figure 5), dark blue for 0 over teal and
/// yellow to red for 1; without confidence all are red. @return vertices and linear colours, no faces
/// @throws InputError naming a vote or confidence that is not finite, and when shapes do not fit
Mesh votes_cloud(const fields::SkeletonField& field, const VotesCloudOptions& options = {});

/// The same with an octahedron per point, as an asset with one joint: what io::write_gltf can write. Viewers draw the
/// points of a GLB one pixel wide, if at all, while octahedra show from every distance.
Asset votes_asset(const fields::SkeletonField& field, const VotesCloudOptions& options = {});

/// Writes the votes by the extension of the path: .ply the points, for programs that measure (colours as 8-bit sRGB, as
/// such programs expect), .glb or .gltf the octahedra, for viewers.
/// @throws InputError on another extension, when no vote is left, and as votes_cloud
void write_votes(const std::filesystem::path& path, const fields::SkeletonField& field,
                 const VotesCloudOptions& options = {});

}  // namespace anigen::pipeline
