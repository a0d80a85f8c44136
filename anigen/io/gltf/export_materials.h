#pragma once
#include <map>
#include <string>

#include "anigen/asset/asset.h"
#include "anigen/io/gltf/export_document.h"

namespace anigen::io {

/// Writes the materials that some face uses, with their textures and images, and a plain white one when some face
/// has none (glTF's implicit default is a metal, which our materials are not). Images are embedded byte for byte.
/// Textures are left out when the mesh has no uvs, since the format forbids them then.
/// @param file only for the message @throws InputError when an image is neither PNG nor JPEG
/// @return index in the file by index in Asset::materials, -1 standing for "none"
std::map<int, int> write_materials(GltfDocument& document, const Asset& asset, const std::string& file);

}  // namespace anigen::io
