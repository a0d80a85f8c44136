#pragma once
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"
#include "anigen/io/gltf/json_text.h"

namespace anigen::io::gltf_import {

/// A copy of a glTF file to which objects are added. JSON that is not changed keeps its text. The bytes of the first
/// buffer, whole and untouched, are the beginning of the copy's binary chunk; what is added comes behind them, at
/// multiples of 4 bytes.
class GraftFile {
 public:
  /// @param container read with its text, and accepted by parse_document(); must outlive this
  /// @throws NotSupportedError when the first buffer is a placeholder without bytes (EXT_meshopt_compression)
  GraftFile(const Container& container, const ImportOptions& options);

  const Json& json() const { return container_.json; }  ///< of the original
  JsonText& text() { return text_; }

  /// Objects of one of the arrays at the top of the file, such as "nodes".
  std::size_t count(const std::string& array) const;  ///< with the added ones
  JsonText::Span original(const std::string& array, std::size_t index);
  /// @param object JSON @return its index
  int add(const std::string& array, std::string object);
  /// In place of the whole array. @pre none was added to it
  void set_array(const std::string& array, const std::vector<std::string>& objects);

  /// Further children of a node of the original, by their numbers. Once for a node.
  void add_children(std::size_t node, const std::vector<std::string>& children);
  /// Members of the file's "extensions", in place of those of the same names, and their names to "extensionsUsed".
  void add_extensions(const Json& members);

  /// An accessor with a view of its own, VEC4 or MAT4, packed. @param vertex_data the view is named as such
  /// @return its index
  template <typename T>
  int add_accessor(const std::vector<T>& values, std::size_t width, bool vertex_data) {
    constexpr Component kComponent = std::is_same_v<T, std::uint8_t>    ? Component::kU8
                                     : std::is_same_v<T, std::uint16_t> ? Component::kU16
                                                                        : Component::kF32;
    static_assert(kComponent != Component::kF32 || std::is_same_v<T, float>, "a type without a name in glTF");
    const int view = add_view({reinterpret_cast<const char*>(values.data()), sizeof(T) * values.size()}, vertex_data);
    return add_accessor(view, kComponent, values.size() / width, width == 4 ? "VEC4" : "MAT4");
  }

  /// A view of numbers that several accessors share.
  int add_numbers(const std::vector<float>& numbers) {
    return add_view({reinterpret_cast<const char*>(numbers.data()), sizeof(float) * numbers.size()}, false);
  }
  /// An accessor of `count` elements of `width` numbers, from the number `first` on: SCALAR, which says its bounds,
  /// VEC3 or VEC4. @param view of add_numbers(numbers) @return its index
  int add_numbers_accessor(int view, const std::vector<float>& numbers, std::size_t first, std::size_t count,
                           std::size_t width);

  /// Puts buffers beyond the first into data URIs and image files into views, byte for byte, so that the copy needs no
  /// other file. Images that are missing stay named.
  void embed_files(Notes& notes);

  /// The finished copy. @param binary a .glb, with the chunks of the original that glTF does not know; else a .gltf
  /// with its first buffer as a data URI. Called once, as the last. @throws NotSupportedError above 4 GiB
  std::string bytes(bool binary);

 private:
  int add_view(std::string_view bytes, bool vertex_data);
  int add_accessor(int view, Component component, std::size_t count, const char* type);
  void set_first_buffer(bool binary);

  const Container& container_;
  JsonPlace root_;
  JsonText text_;
  std::uintmax_t max_bytes_;
  std::string binary_;
  std::map<std::string, std::vector<JsonText::Span>> originals_;
  std::map<std::string, std::vector<std::string>> added_;
};

}  // namespace anigen::io::gltf_import
