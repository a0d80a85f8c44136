#pragma once
#include <cstdint>
#include <functional>
#include <string>

#include "anigen/asset/asset.h"
#include "anigen/fields/mesh_extraction.h"
#include "anigen/fields/skeleton_field.h"

namespace anigen::pipeline {

struct DecodedAssetOptions {
  std::string name;            ///< of the asset
  float least_weight = 1e-4F;  ///< lighter influences are dropped: a softmax is nowhere zero; the heaviest always stays
  std::int64_t chunk = 1 << 14;  ///< vertices whose dense weights are asked for at a time
};

/// Dense skin weights of the vertices [begin, end): [end - begin, J] floating, any device, rows sum to 1.
using SkinWeightRows = std::function<torch::Tensor(std::int64_t begin, std::int64_t end)>;

/// A decoded asset as the world outside knows it, ready for io::write_gltf: the mesh with vertex normals; the decoder's
/// colours, which are those of pictures (sRGB), as linear vertex colours; the skeleton repaired as published and then
/// as one tree with the root first (geometry::one_rooted_tree), joints called by chain and side
/// (geometry::joint_names); skin weights sparse, their columns in the same order, rows divided by the sum of what is
/// left. The frame stays: object space is the project's world. Vertices keep their order.
/// @param weights asked for chunk by chunk in ascending order, so that [V, J] never needs to exist
/// @throws InputError without a surface or joints; on shapes that do not fit; naming what is not finite (a vertex,
/// joint,
///   colour or weight), a face that refers to no vertex, and a vertex without a positive weight
Asset decoded_asset(const fields::ExtractedMesh& mesh, const fields::SkeletonTensors& skeleton,
                    const SkinWeightRows& weights, const DecodedAssetOptions& options = {});
/// @param weights [V, J]
Asset decoded_asset(const fields::ExtractedMesh& mesh, const fields::SkeletonTensors& skeleton,
                    const torch::Tensor& weights, const DecodedAssetOptions& options = {});

/// The same of a model that has no rig: mesh, normals and colours, held by one joint (bind_rigidly). @throws as
/// decoded_asset, for what concerns the mesh
Asset decoded_shape(const fields::ExtractedMesh& mesh, const std::string& name);

}  // namespace anigen::pipeline
