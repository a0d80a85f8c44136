#pragma once
#include <Eigen/Core>
#include <map>
#include <string>

#include "anigen/asset/asset.h"
#include "anigen/io/gltf/export_document.h"

namespace anigen::io {

/// Writes the only mesh of the file: one primitive per material, all with the same vertex accessors, so that vertex
/// order and count survive. Faces are grouped by material and keep their order within a group.
/// @param rotation  world → file, see axis_rotation
/// @param materials index in the file by index in Asset::materials, from write_materials
void write_mesh(GltfDocument& document, const Asset& asset, const Eigen::Matrix3d& rotation,
                const std::map<int, int>& materials, std::size_t influences);

}  // namespace anigen::io
