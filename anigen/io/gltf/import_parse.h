#pragma once
#include <cstdint>

#include "anigen/io/gltf/import_container.h"
#include "anigen/io/gltf/import_document.h"
#include "anigen/io/gltf/import_json.h"
#include "anigen/io/gltf/import_notes.h"

namespace anigen::io::gltf_import {

/// Checks a glTF's JSON and its buffers and turns them into a Document. @throws InputError, NotSupportedError
/// @param container must outlive the result, whose views may point into its binary chunk
Document parse_document(const Container& container, const ImportOptions& options, Notes& notes);

/// The parts of parse_document, in the order they need each other.
void parse_buffers(const JsonPlace& root, const Container& container, const ImportOptions& options, Document& document,
                   Notes& notes);
void parse_accessors(const JsonPlace& root, const ImportOptions& options, Document& document);
void parse_materials(const JsonPlace& root, Document& document, Notes& notes);
void parse_meshes(const JsonPlace& root, Document& document);
void parse_nodes(const JsonPlace& root, const ImportOptions& options, Document& document, Notes& notes);
void parse_skins(const JsonPlace& root, Document& document);
void parse_animations(const JsonPlace& root, Document& document, Notes& notes);

/// Largest offset or length that is read: well inside 64 bits, so that sums cannot overflow.
inline constexpr std::uint64_t kMostBufferBytes = std::uint64_t{1} << 40;

/// Size in bytes of one component, and of one element with the padding that glTF asks of matrix columns.
std::size_t component_size(Component component);
std::size_t element_size(const std::string& type, Component component);

}  // namespace anigen::io::gltf_import
