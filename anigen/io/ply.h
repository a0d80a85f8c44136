#pragma once
#include <filesystem>

#include "anigen/asset/mesh.h"

namespace anigen::io {

/// ASCII and binary (either endianness); vertices x, y, z, optional normals, optional red/green/blue/alpha,
/// optional texture coordinates (s/t, u/v or texture_u/texture_v), optional faces (polygons are triangulated as fans);
/// a file without faces is a point cloud. Axes as in the file.
/// @throws InputError naming line or byte, NotSupportedError for triangle strips
Mesh read_ply(const std::filesystem::path& path);
/// Binary little-endian, atomic; what the mesh has of normals, texture coordinates and faces. Colours are written as
/// 8-bit when the mesh has them.
void write_ply(const std::filesystem::path& path, const Mesh& mesh);

}  // namespace anigen::io
