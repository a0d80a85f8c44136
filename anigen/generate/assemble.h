#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "anigen/asset/rigged_asset.h"
#include "anigen/shape_field/mesh_extraction.h"
#include "anigen/skeleton_field/field.h"

namespace anigen::generate {

struct DecodedAssetOptions {
  std::string name;            ///< of the asset
  float least_weight = 1e-4F;  ///< lighter influences are dropped: a softmax is nowhere zero; the heaviest always stays
  std::int64_t chunk = 1 << 14;  ///< vertices whose dense weights are asked for at a time
};

/// Dense skin weights of the vertices [begin, end): [end - begin, J] floating, any device, rows sum to 1.
using SkinWeightRows = std::function<torch::Tensor(std::int64_t begin, std::int64_t end)>;

/// A decoded asset as the world outside knows it, ready for io::write_gltf: the mesh with vertex normals; the decoder's
/// colours, which are those of pictures (sRGB), as linear vertex colours; the skeleton repaired as published and then
/// as one tree with the root first (skeleton_field::one_rooted_tree), joints called by chain and side
/// (joint_names); skin weights sparse, their columns in the same order, rows divided by the sum of what is
/// left. The frame stays: object space is the project's world. Vertices keep their order.
/// @param weights asked for chunk by chunk in ascending order, so that [V, J] never needs to exist
/// @throws InputError without a surface or joints; on shapes that do not fit; naming what is not finite (a vertex,
/// joint,
///   colour or weight), a face that refers to no vertex, and a vertex without a positive weight
Asset decoded_asset(const shape_field::ExtractedMesh& mesh, const skeleton_field::SkeletonTensors& skeleton,
                    const SkinWeightRows& weights, const DecodedAssetOptions& options = {});
/// @param weights [V, J]
Asset decoded_asset(const shape_field::ExtractedMesh& mesh, const skeleton_field::SkeletonTensors& skeleton,
                    const torch::Tensor& weights, const DecodedAssetOptions& options = {});

/// The skeleton of a decoded asset by itself. @throws InputError as decoded_asset, for what concerns the skeleton
Skeleton decoded_skeleton(const skeleton_field::SkeletonTensors& skeleton);

/// Asset of a model that has no rig: mesh, normals and colours, held by one joint (bind_rigidly). @throws as
/// decoded_asset, for what concerns the mesh
Asset decoded_shape(const shape_field::ExtractedMesh& mesh, const std::string& name);

enum class VotesShown { kJoints, kParents };

struct VotesCloudOptions {
  VotesShown shown = VotesShown::kJoints;  ///< with their own confidence each
  float least_confidence = 0.0F;           ///< votes below it are left out
  float radius = 0.002F;                   ///< of a vote drawn as an octahedron, object space (a voxel is 1/64 wide)
};

/// The votes of a skeleton field as points coloured by confidence (paper Figure 5), dark blue for 0 over teal and
/// yellow to red for 1; without confidence all are red. @return vertices and linear colours, no faces
/// @throws InputError naming a vote or confidence that is not finite, and when shapes do not fit
Mesh votes_cloud(const skeleton_field::SkeletonField& field, const VotesCloudOptions& options = {});

/// Votes with an octahedron per point, as an asset with one joint: what io::write_gltf can write. Viewers draw the
/// points of a GLB one pixel wide, if at all, while octahedra show from every distance.
Asset votes_asset(const skeleton_field::SkeletonField& field, const VotesCloudOptions& options = {});

/// Writes the votes by the extension of the path: .ply the points, for programs that measure (colours as 8-bit sRGB, as
/// such programs expect), .glb or .gltf the octahedra, for viewers.
/// @throws InputError on another extension, when no vote is left, and as votes_cloud
void write_votes(const std::filesystem::path& path, const skeleton_field::SkeletonField& field,
                 const VotesCloudOptions& options = {});

}  // namespace anigen::generate
