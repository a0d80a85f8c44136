#pragma once
#include <filesystem>
#include <string>
#include <string_view>

#include "anigen/core/json.h"
#include "anigen/io/gltf.h"

namespace anigen::io::gltf_import {

/// A .gltf or .glb taken apart: its JSON and its binary chunk. Not copyable, since `binary` points into `bytes`.
struct Container {
  std::string file;              ///< path as the user gave it
  std::filesystem::path folder;  ///< what relative URIs start from
  Json json;
  std::string bytes;        ///< of a .glb; empty for a .gltf
  std::string_view binary;  ///< the BIN chunk
  bool has_binary = false;

  Container() = default;
  Container(const Container&) = delete;
  Container& operator=(const Container&) = delete;
};

/// Reads the file and splits it, by its magic number and not by its name (glTF 2.0, section 4.4: GLB). Git LFS
/// pointers, lengths that disagree with the file, wrong versions, over-deep or over-long JSON are refused.
/// @throws InputError with the byte offset
void read_container(const std::filesystem::path& path, const ImportOptions& options, Container& container);

}  // namespace anigen::io::gltf_import
