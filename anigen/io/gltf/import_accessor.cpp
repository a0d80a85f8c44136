#include "anigen/io/gltf/import_accessor.h"

#include <algorithm>
#include <cstring>

#include "anigen/core/error.h"
#include "anigen/io/gltf/import_parse.h"

namespace anigen::io::gltf_import {
namespace {

// glTF data need not be aligned for the host; memcpy compiles to a plain load.
template <typename T>
T load(const char* source) {
  T value;
  std::memcpy(&value, source, sizeof value);
  return value;
}

double component_at(const char* source, Component component) {
  switch (component) {
    case Component::kI8:
      return load<std::int8_t>(source);
    case Component::kU8:
      return load<std::uint8_t>(source);
    case Component::kI16:
      return load<std::int16_t>(source);
    case Component::kU16:
      return load<std::uint16_t>(source);
    case Component::kU32:
      return load<std::uint32_t>(source);
    case Component::kF32:
      return static_cast<double>(load<float>(source));
  }
  return 0.0;
}

// Byte offset of component c inside an element: matrix columns start at multiples of 4.
std::size_t component_offset(const Accessor& accessor, std::size_t c) {
  const std::size_t size = component_size(accessor.component);
  const std::size_t rows = accessor.type == "MAT2" ? 2 : accessor.type == "MAT3" ? 3 : accessor.width;
  return c / rows * ((rows * size + 3) / 4 * 4) + c % rows * size;
}

template <typename T>
void read_element(const Accessor& accessor, const char* source, bool normalize, T* target) {
  const double scale = normalize && accessor.normalized ? normalized_scale(accessor.component) : 1.0;
  for (std::size_t c = 0; c < accessor.width; ++c) {
    double value = component_at(source + component_offset(accessor, c), accessor.component);
    if (scale != 1.0) value = std::max(value * scale, -1.0);
    target[c] = static_cast<T>(value);
  }
}

template <typename T>
std::vector<T> read(const Document& document, int index, bool normalize, std::size_t at_most) {
  const Accessor& accessor = document.accessors[static_cast<std::size_t>(index)];
  const std::size_t count = std::min(accessor.count, at_most);
  std::vector<T> values(count * accessor.width, T(0));
  if (accessor.view >= 0) {
    const char* source = document.views[static_cast<std::size_t>(accessor.view)].bytes.data() + accessor.offset;
    for (std::size_t i = 0; i < count; ++i)
      read_element(accessor, source + i * accessor.stride, normalize, values.data() + i * accessor.width);
  }
  const Accessor::Sparse& sparse = accessor.sparse;
  if (sparse.count == 0) return values;
  const char* indices = document.views[static_cast<std::size_t>(sparse.index_view)].bytes.data() + sparse.index_offset;
  const char* source = document.views[static_cast<std::size_t>(sparse.value_view)].bytes.data() + sparse.value_offset;
  const std::size_t index_size = component_size(sparse.index_component);
  const std::size_t size = element_size(accessor.type, accessor.component);
  for (std::size_t i = 0; i < sparse.count; ++i) {
    const auto target = static_cast<std::size_t>(component_at(indices + i * index_size, sparse.index_component));
    if (target >= accessor.count) {
      throw InputError(
          document.file, accessor.pointer + "/sparse/indices",
          "sparse index " + std::to_string(target) + " of " + std::to_string(accessor.count) + " elements");
    }
    if (target < count) read_element(accessor, source + i * size, normalize, values.data() + target * accessor.width);
  }
  return values;
}

}  // namespace

double normalized_scale(Component component) {
  switch (component) {
    case Component::kI8:
      return 1.0 / 127.0;
    case Component::kU8:
      return 1.0 / 255.0;
    case Component::kI16:
      return 1.0 / 32767.0;
    case Component::kU16:
      return 1.0 / 65535.0;
    case Component::kU32:
      return 1.0 / 4294967295.0;
    case Component::kF32:
      return 1.0;
  }
  return 1.0;
}

std::vector<float> read_floats(const Document& document, int accessor) {
  return read<float>(document, accessor, true, ~std::size_t{0});
}

std::vector<double> read_doubles(const Document& document, int accessor, std::size_t at_most) {
  return read<double>(document, accessor, true, at_most);
}

std::vector<std::uint32_t> read_unsigned(const Document& document, int accessor) {
  return read<std::uint32_t>(document, accessor, false, ~std::size_t{0});
}

}  // namespace anigen::io::gltf_import
