#pragma once
#include <filesystem>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/io/gltf.h"
#include "anigen/io/gltf/import_document.h"
#include "anigen/io/gltf/import_notes.h"

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
