#pragma once
#include <filesystem>
#include <string>

#include "anigen/asset/rigged_asset.h"

namespace anigen::studio {

/// Writes an asset in the format of the extension: .glb .fbx .usdz, .vrm without clips, .zip (obj_archive.h). By
/// rename.
/// @throws InputError for .vrm naming the bones of a human that it lacks, and as engine::save(); WriteError
void write_rig_file(const Asset& asset, const std::filesystem::path& file);

/// The asset with names of a preset. Clips stay unless the preset's tree of joints is another one.
/// @param preset one of name_presets() @throws InputError naming the bones of a human that it lacks
Asset renamed(const Asset& asset, const std::string& preset);

}  // namespace anigen::studio
