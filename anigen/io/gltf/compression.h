#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "anigen/io/gltf/document.h"

// Decoders of glTF's two compressions, by meshoptimizer and Draco. Lean builds refuse such files.

namespace anigen::io::gltf_import {

/// A buffer view of EXT_meshopt_compression.
/// @param source the extension's bytes, already cut out of their buffer
/// @param expected length the bufferView declares, which the decoded data must have
/// @throws InputError for damaged data, and for what the extension does not allow
std::string decode_meshopt(const JsonPlace& extension, std::string_view source, std::size_t expected);

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
