#pragma once
#include <filesystem>

#include "anigen/asset/mesh.h"

namespace anigen::io {

/// Binary or text, told by the file's size and first word, since binary files may begin with "solid", too. Corners in
/// one place become one vertex, numbered as they appear; triangles that name a vertex twice are left out. Normals are
/// those of the faces again, so they are not kept; nor are the two bytes in which some tools hide a colour. Axes as in
/// the file.
/// @throws InputError naming line or byte: cut short, a word or number that does not belong there, a number that is not
/// finite, no triangle
Mesh read_stl(const std::filesystem::path& path);
/// Binary, atomic: corners and normals of faces, nothing else of the mesh.
/// @throws InputError when the mesh is unsound or has no faces, or more than the format can count
void write_stl(const std::filesystem::path& path, const Mesh& mesh);

}  // namespace anigen::io
