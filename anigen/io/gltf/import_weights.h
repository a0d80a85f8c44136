#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/skin_weights.h"
#include "anigen/io/gltf/import_bind.h"
#include "anigen/io/gltf/import_primitive.h"

namespace anigen::io::gltf_import {

/// Appends one row per vertex of a skinned primitive, repaired where the file's weights are wrong, and notes every
/// kind of repair with its count: "negative_weights" (taken as 0), "unnormalised_weights" (divided by their sum),
/// "nan_weights" and "zero_weights" (bound like the nearest vertex of the primitive with proper weights, or to the
/// joint nearest in the bind pose when it has none).
/// @param pointer of the primitive, for errors @param joint_positions of the rig in the bind pose, [J]
/// @throws InputError when a joint index with weight lies outside the skin
void append_weights(const VertexBlock& block, const SkinBinding& binding,
                    const std::vector<Eigen::Vector3d>& joint_positions, const std::string& file,
                    const std::string& pointer, SkinWeights& weights, Notes& notes);

}  // namespace anigen::io::gltf_import
