#pragma once
#include <filesystem>
#include <string>

#include "anigen/asset/mesh.h"

namespace anigen::io {

/// Place of a texture or a library of materials, relative to the folder of the model that names it: where the model
/// says, or, since exporters write paths of the author's disk, under its name beside the model or in the folder
/// "textures". Nothing outside the model's folder is looked at. @return only the name when it is nowhere
std::filesystem::path find_named_file(std::string named, const std::filesystem::path& folder);

/// A picture file as a texture: PNG and JPEG as they are, what else image readers know as PNG.
/// @throws InputError naming the file: not there, larger than 256 MiB, or no picture
EncodedImage read_texture(const std::filesystem::path& file);

}  // namespace anigen::io
