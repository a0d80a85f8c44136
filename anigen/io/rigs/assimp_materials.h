#pragma once
#include <assimp/scene.h>

#include <filesystem>

#include "anigen/io/gltf/import_document.h"

namespace anigen::io::assimp_import {

/// Appends the materials with the textures of their base colour: embedded PNG and JPEG pictures, and files that lie
/// where the material says or, since exporters write paths of the author's disk, under that name beside the model or in
/// its folder "textures". Nothing outside the model's folder is looked at.
void add_materials(const aiScene& scene, const std::filesystem::path& folder, gltf_import::Document& document);

}  // namespace anigen::io::assimp_import
