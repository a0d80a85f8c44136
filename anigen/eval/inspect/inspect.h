#pragma once
#include <filesystem>
#include <string>

#include "anigen/core/json.h"
#include "anigen/io/gltf.h"

namespace anigen::eval {

/// What a file or folder is.
enum class FileKind { kAsset, kArrays, kConfig, kDataset, kRun };

/// By extension for files (.glb .gltf; .npz .safetensors .pt .pth; .json), by content for folders (metadata.csv:
/// dataset; config.json or ckpts: run). @throws InputError for anything else
FileKind file_kind(const std::filesystem::path& path);

/// Each describes one kind as JSON: counts, names, ranges. What could not be read is an InputError.
Json describe_asset(const io::ImportedAsset& imported);
Json describe_arrays(const std::filesystem::path& file);
Json describe_config(const std::filesystem::path& file);
Json describe_dataset(const std::filesystem::path& folder);
Json describe_run(const std::filesystem::path& folder);

/// The description of a file or folder with its `file` and `kind` first.
Json inspect(const std::filesystem::path& path);

/// Any JSON as indented lines "key: value" for people; lists of plain values stay on one line.
std::string to_text(const Json& description);

}  // namespace anigen::eval
