#pragma once
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "anigen/io/gltf/import_document.h"

namespace anigen::io::gltf_import {

/// A primitive decoded from KHR_draco_mesh_compression.
struct DracoMesh {
  std::size_t vertices = 0;
  std::vector<std::uint32_t> indices;  ///< triangle list
  /// Row-major [vertices, width of the accessor]; normalised as the accessor says.
  std::vector<std::pair<std::string, std::vector<float>>> attributes;
};

/// @param max_vertices, max_faces refuse larger meshes, as far as possible before decoding
/// @throws InputError when the data cannot be decoded or does not fit the primitive's accessors
DracoMesh decode_draco(const Document& document, const Primitive& primitive, std::size_t max_vertices,
                       std::size_t max_faces);

}  // namespace anigen::io::gltf_import
