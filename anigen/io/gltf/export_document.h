#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/json.h"

namespace anigen::io {

/// glTF's numbers for the OpenGL constants that exporters need.
enum class ComponentType { kUint8 = 5121, kUint16 = 5123, kUint32 = 5125, kFloat = 5126 };
enum class ViewTarget { kNone = 0, kVertices = 34962, kIndices = 34963 };

/// A glTF file being written: its JSON and its only binary buffer. Views and accessors are appended as the parts of
/// the asset are written, each aligned to 4 bytes.
class GltfDocument {
 public:
  GltfDocument();

  Json json;  ///< everything but "buffers", "bufferViews" and "accessors", which json_text() adds

  /// Copies bytes into the buffer. @return the index of the bufferView
  int add_view(const void* data, std::size_t bytes, ViewTarget target);

  /// An accessor into a view. @param type "SCALAR", "VEC3", … @return its index
  int add_accessor(int view, std::size_t byte_offset, ComponentType component, const char* type, std::size_t count);
  /// Adds the accessor's "min" and "max", which are exact because every float is a double.
  void set_bounds(int accessor, const std::vector<float>& values, std::size_t width);

  /// A view of its own with one accessor. @param width numbers per element: 1, 2, 3, 4 or 16
  int add_floats(const std::vector<float>& values, std::size_t width, ViewTarget target);
  int add_uint8(const std::vector<std::uint8_t>& values, std::size_t width, ViewTarget target);
  int add_uint16(const std::vector<std::uint16_t>& values, std::size_t width, ViewTarget target);
  int add_uint32(const std::vector<std::uint32_t>& values, std::size_t width, ViewTarget target);

  const std::string& binary() const { return binary_; }
  /// The finished JSON. @param buffer_uri "uri" of the buffer; empty for the binary chunk of a .glb
  std::string json_text(const std::string& buffer_uri) const;

 private:
  std::string binary_;
  Json views_ = Json::array(), accessors_ = Json::array();
};

/// "SCALAR", "VEC2", "VEC3", "VEC4" or "MAT4" for 1, 2, 3, 4 or 16 numbers per element.
const char* accessor_type(std::size_t width);

}  // namespace anigen::io
