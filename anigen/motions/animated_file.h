#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/gltf/gltf.h"

namespace anigen::motions {

/// Extensions of files that can be animated.
const std::vector<std::string>& animated_extensions();

/// Reads a .glb, .gltf, .fbx or .dae, named by its file. @throws InputError as the readers, or for another extension
io::ImportedAsset read_animated(const std::filesystem::path& file);

/// Writes an asset with new clips: from glTF to glTF a copy of the file with the clips added, else a new file with base
/// colours alone, which a note says. @param asset read from `original`; gets the clips where the file is written anew
/// @param keep_clips those that it has stay, before the new ones
/// @return true for a copy @throws InputError and WriteError as the writers
bool write_animated(const std::filesystem::path& original, Asset& asset, const std::vector<Animation>& clips,
                    bool keep_clips, const std::filesystem::path& out, std::vector<std::string>& notes);

}  // namespace anigen::motions
