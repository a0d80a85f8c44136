#pragma once
#include <filesystem>
#include <string>

#include "anigen/io/gltf/export_document.h"

namespace anigen::io {

/// True for .glb, false for .gltf, in any case. @throws InputError on another extension
bool is_binary_extension(const std::filesystem::path& path);

/// The bytes of a .glb: header, JSON chunk, binary chunk (glTF 2.0, section 4.4).
/// @param file only for the message @throws NotSupportedError when it would exceed the format's 4 GiB
std::string glb_bytes(const GltfDocument& document, const std::string& file);

/// The bytes of a .gltf whose buffer is a base64 data URI.
std::string embedded_gltf_bytes(const GltfDocument& document);

}  // namespace anigen::io
