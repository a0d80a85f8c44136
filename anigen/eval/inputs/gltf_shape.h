#pragma once
#include <filesystem>
#include <string>

#include "anigen/eval/inputs/axes.h"

namespace anigen::eval {

/// A rigged glTF file, its import's notes kept. @param axes kZUp for files whose writer did not turn Z up to glTF's
/// Y up: the import's turn is then taken back
/// @throws InputError with file and place, also when nothing is skinned; NotSupportedError naming an extension
RiggedShape read_gltf_shape(const std::filesystem::path& file, const std::string& id, Axes axes = Axes::kFormat);

}  // namespace anigen::eval
