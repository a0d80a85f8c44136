#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "anigen/io/gltf/import_document.h"
#include "anigen/io/gltf/import_notes.h"

namespace anigen::io::assimp_import {

/// Puts arrays into a document as accessors, so that the stages of the glTF importer can read them.
class DocumentArrays {
 public:
  explicit DocumentArrays(gltf_import::Document& document) : document_(document) {}

  /// @param values [count, width of type], row-major @param type "SCALAR", "VEC3", … @return the accessor
  int add(const std::vector<float>& values, const std::string& type, std::size_t width, const std::string& place);
  int add(const std::vector<std::uint16_t>& values, const std::string& type, std::size_t width,
          const std::string& place);
  int add(const std::vector<std::uint32_t>& values, const std::string& type, std::size_t width,
          const std::string& place);
  /// @return the view
  int add_bytes(std::string bytes);

 private:
  int add(const void* values, std::size_t bytes, std::size_t item, gltf_import::Component component,
          const std::string& type, std::size_t width, const std::string& place);

  gltf_import::Document& document_;
};

/// A document whose arrays DocumentArrays made, with the notes of making it, as bytes for another process of this
/// program.
std::string to_bytes(const gltf_import::Document& document, const gltf_import::Notes& notes);
/// @throws Error when the bytes are not those of to_bytes()
void from_bytes(std::string_view bytes, gltf_import::Document& document, gltf_import::Notes& notes);

}  // namespace anigen::io::assimp_import
