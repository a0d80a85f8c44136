#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/gltf/gltf.h"

namespace anigen::io {

/// Formats that rigged assets are written in, as words of a command line: "glb", "fbx", …
std::vector<std::string> rigged_format_words();

/// True for the extension of a format that rigged assets are written in: .glb, .gltf, .fbx, .usda, .usdz.
bool is_rigged_output(const std::filesystem::path& file);

/// Writes an asset in the format of the file's extension, atomically: write_gltf(), write_fbx() or write_usd().
/// @throws InputError for another extension, and as these do
void write_rigged(const std::filesystem::path& file, const Asset& asset, const ExportOptions& options = {});

}  // namespace anigen::io
