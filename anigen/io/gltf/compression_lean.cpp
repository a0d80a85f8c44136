#include "anigen/core/error.h"
#include "anigen/io/gltf/compression.h"

namespace anigen::io::gltf_import {

std::string decode_meshopt(const JsonPlace& extension, std::string_view /*source*/, std::size_t /*expected*/) {
  extension.not_supported("EXT_meshopt_compression by a build without meshoptimizer");
}

DracoMesh decode_draco(const Document& document, const Primitive& primitive, std::size_t /*max_vertices*/,
                       std::size_t /*max_faces*/) {
  throw NotSupportedError(document.file, primitive.pointer + "/extensions/KHR_draco_mesh_compression",
                          "Draco by a build without its library");
}

}  // namespace anigen::io::gltf_import
