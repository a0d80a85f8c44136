#pragma once
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"
#include "anigen/io/gltf/export.h"
#include "anigen/io/gltf/gltf.h"

namespace anigen::io::gltf_import {

struct MaterialSet {
  std::vector<Material> materials;   ///< as many as the file has, in its order
  std::vector<EncodedImage> images;  ///< only those that a material shows
};

/// Materials with the pictures of their base colour, as encoded bytes. A picture that is missing, or neither PNG nor
/// JPEG, is left out and noted: an asset without its texture still is worth having.
/// @throws InputError on a URI that is refused, or when the pictures together are too large
MaterialSet read_materials(const Document& document, const std::filesystem::path& folder, const ImportOptions& options,
                           Notes& notes);

}  // namespace anigen::io::gltf_import

namespace anigen::io {

/// Writes the materials that some face uses, with their textures and images, and a plain white one when some face
/// has none (glTF's implicit default is a metal, which our materials are not). Images are embedded byte for byte.
/// Textures are left out when the mesh has no uvs, since the format forbids them then.
/// @param file only for the message @throws InputError when an image is neither PNG nor JPEG
/// @return index in the file by index in Asset::materials, -1 standing for "none"
std::map<int, int> write_materials(GltfDocument& document, const Asset& asset, const std::string& file);

}  // namespace anigen::io
