#include "anigen/io/rigs/assimp_document.h"

#include <memory>
#include <utility>

namespace anigen::io::assimp_import {

using gltf_import::Component;

int DocumentArrays::add_bytes(std::string bytes) {
  document_.storage.push_back(std::make_unique<std::string>(std::move(bytes)));
  gltf_import::BufferView view;
  view.bytes = *document_.storage.back();
  document_.views.push_back(view);
  return static_cast<int>(document_.views.size()) - 1;
}

int DocumentArrays::add(const void* values, std::size_t bytes, std::size_t item, Component component,
                        const std::string& type, std::size_t width, const std::string& place) {
  gltf_import::Accessor accessor;
  accessor.view = add_bytes(std::string(static_cast<const char*>(values), bytes));
  accessor.pointer = place;
  accessor.stride = item * width;
  accessor.count = bytes / accessor.stride;
  accessor.width = width;
  accessor.component = component;
  accessor.type = type;
  document_.accessors.push_back(std::move(accessor));
  return static_cast<int>(document_.accessors.size()) - 1;
}

int DocumentArrays::add(const std::vector<float>& values, const std::string& type, std::size_t width,
                        const std::string& place) {
  return add(values.data(), 4 * values.size(), 4, Component::kF32, type, width, place);
}

int DocumentArrays::add(const std::vector<std::uint16_t>& values, const std::string& type, std::size_t width,
                        const std::string& place) {
  return add(values.data(), 2 * values.size(), 2, Component::kU16, type, width, place);
}

int DocumentArrays::add(const std::vector<std::uint32_t>& values, const std::string& type, std::size_t width,
                        const std::string& place) {
  return add(values.data(), 4 * values.size(), 4, Component::kU32, type, width, place);
}

}  // namespace anigen::io::assimp_import
