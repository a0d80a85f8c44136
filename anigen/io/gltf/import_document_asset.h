#pragma once
#include <filesystem>

#include "anigen/io/gltf.h"
#include "anigen/io/gltf/import_document.h"
#include "anigen/io/gltf/import_notes.h"

namespace anigen::io::gltf_import {

/// Last step of every importer that fills a Document: one skeleton, one mesh in its bind pose, materials, animations,
/// or what of these options.require_rig lets be missing; repaired where the file is wrong. @param path of the file;
/// pictures are read from its folder
/// @throws InputError also when the result is no sound asset
ImportedAsset document_asset(const Document& document, const std::filesystem::path& path, const ImportOptions& options,
                             Notes& notes);

}  // namespace anigen::io::gltf_import
