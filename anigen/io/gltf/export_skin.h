#pragma once
#include <Eigen/Core>
#include <string>

#include "anigen/asset/asset.h"
#include "anigen/io/gltf/export_document.h"

namespace anigen::io {

/// Adds JOINTS_n and WEIGHTS_n (float) for as many sets of four as the rows need, at most `influences` joints each.
/// Joint indices are 8-bit up to 255 joints, else 16-bit. Unused slots hold joint 0 with weight 0.
void write_skin_attributes(GltfDocument& document, Json& attributes, const SkinWeights& skin, std::size_t joints,
                           std::size_t influences);

/// Writes the skin: all joints in skeleton order (their node index is their joint index), the root as "skeleton",
/// and the inverse of rotation · bind as inverse bind matrices.
/// @param file only for the message @throws InputError when a matrix does not fit single precision
void write_skin(GltfDocument& document, const Skeleton& skeleton, const Eigen::Matrix3d& rotation,
                const std::string& file);

}  // namespace anigen::io
