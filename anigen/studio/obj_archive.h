#pragma once
#include <filesystem>

#include "anigen/asset/rigged_asset.h"

namespace anigen::studio {

/// Writes an asset for programs that read neither glTF nor FBX: a ZIP archive of model.obj, Y up, with the materials in
/// model.mtl and their textures, and model.rig.json with joints and weights (io::write_obj_rig). By rename.
/// @throws InputError when the mesh is unsound; WriteError
void write_obj_archive(const Asset& asset, const std::filesystem::path& file);

}  // namespace anigen::studio
