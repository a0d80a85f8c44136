#pragma once
#include <string>
#include <string_view>

#include "anigen/io/gltf/import_json.h"

namespace anigen::io::gltf_import {

/// Decodes a bufferView compressed by EXT_meshopt_compression.
/// @param extension the extension's object @param source its bytes, already cut out of their buffer
/// @param expected  length the bufferView declares, which the decoded data must have
/// @throws InputError when the parameters break the extension's rules or the data cannot be decoded
std::string decode_meshopt(const JsonPlace& extension, std::string_view source, std::size_t expected);

}  // namespace anigen::io::gltf_import
