#pragma once
#include <filesystem>

#include "anigen/asset/mesh.h"

namespace anigen::io {

/// Vertices, texture coordinates, normals and polygons (triangulated as fans); vertex colours after the position
/// as several tools write them. Axes as in the file. Vertices are split where a corner uses another uv or normal.
/// @throws InputError naming the line
Mesh read_obj(const std::filesystem::path& path);
void write_obj(const std::filesystem::path& path, const Mesh& mesh);  ///< atomic

}  // namespace anigen::io
