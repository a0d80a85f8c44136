#pragma once
#include <filesystem>
#include <string>

#include "anigen/io/ndarray.h"

namespace anigen::io {

/// sha256 of the arrays, sorted by name: of each its name, dtype, shape and bytes. So it does not matter in which file
/// or in which order they are.
std::string content_id(NamedArrays arrays);

/// sha256 of a .gltf followed by its external buffers in order. @throws InputError when one is missing or lies outside
/// the folder
std::string gltf_content_id(const std::filesystem::path& file);

}  // namespace anigen::io
