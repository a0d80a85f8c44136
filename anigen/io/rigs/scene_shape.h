#pragma once
#include <filesystem>
#include <string>

#include "anigen/io/rigs/axes.h"

namespace anigen::io {

/// A rigged glTF, FBX or COLLADA file, told by its extension, its import's notes kept. @param axes kZUp for files whose
/// writer did not turn Z up to the format's Y up: the import's turn is then taken back
/// @param require_rig false: a file in which nothing is skinned is read, too (ImportOptions::require_rig)
/// @throws InputError with file and place, also when nothing is skinned; NotSupportedError naming an extension
RiggedShape read_scene_shape(const std::filesystem::path& file, const std::string& id, Axes axes = Axes::kFormat,
                             bool require_rig = true);

}  // namespace anigen::io
