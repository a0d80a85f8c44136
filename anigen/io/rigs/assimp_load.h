#pragma once
#include <assimp/scene.h>

#include <assimp/Importer.hpp>
#include <filesystem>
#include <string>

#include "anigen/io/gltf.h"

namespace anigen::io::assimp_import {

/// Assimp's scene of a file: triangles only, every index, pointer and count in it checked. It lives as long as the
/// importer. @throws InputError, NotSupportedError
/// @param frame set to what a COLLADA file says
const aiScene& load(Assimp::Importer& importer, const std::filesystem::path& file, const ImportOptions& options,
                    FileFrame& frame);

}  // namespace anigen::io::assimp_import
