#pragma once
#include <filesystem>
#include <string>

#include "anigen/asset/rigged_asset.h"

namespace anigen::engine {

/// Reads one asset. .glb, .gltf, .fbx and .dae with mesh, skeleton, weights and clips as far as there are any; .obj,
/// .ply, .stl and .3mf have a mesh alone. World frame: Z up, the file's unit.
/// @throws InputError with file and place, also for a file that holds several assets; NotSupportedError naming what
/// the file needs
Asset load(const std::filesystem::path& file);

/// Likewise from memory. @param name with the extension of the format, such as "fox.glb"; a .gltf has everything
/// embedded, and no format refers to other files
Asset load_bytes(const std::string& bytes, const std::string& name);

/// Writes an asset in the format of the extension, .glb .gltf .fbx .usda .usdz, by rename. A mesh without a rig is
/// written by .glb and .gltf. @throws InputError naming what is unsound in the asset; WriteError when the disk refuses
void save(const Asset& asset, const std::filesystem::path& file);

/// Contents of the file that save() would write. @param format "glb", "gltf", "fbx" or "usdz"
std::string save_bytes(const Asset& asset, const std::string& format = "glb");

}  // namespace anigen::engine
