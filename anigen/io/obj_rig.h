#pragma once
#include <filesystem>

#include "anigen/asset/asset.h"
#include "anigen/io/gltf.h"

namespace anigen::io {

/// An asset for programs that read no glTF: the mesh as OBJ, and beside it `<stem>.rig.json` with `joints`, a list of
/// {name, parent, position}, parents first, -1 for the root; and `skin`, for each vertex in the OBJ's order a list of
/// [joint, weight], heaviest first, summing to 1. Both in these axes, in the asset's unit. Written atomically, the rig
/// last. @throws InputError when the mesh is unsound, or has not as many rows of weights as vertices
void write_obj_rig(const std::filesystem::path& obj, const Asset& asset, ExportAxes axes = ExportAxes::kGltf);

}  // namespace anigen::io
