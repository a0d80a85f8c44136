#include <algorithm>

#include "anigen/io/gltf/import_parse.h"

namespace anigen::io::gltf_import {
namespace {

Component component_of(const JsonPlace& place) {
  const std::uint64_t code = place.integer(0, 65535);
  if (code < 5120 || code > 5126 || code == 5124) place.fail("unknown componentType " + std::to_string(code));
  return static_cast<Component>(code);
}

std::size_t width_of(const JsonPlace& place) {
  const std::string type = place.string();
  if (type == "SCALAR") return 1;
  if (type == "VEC2") return 2;
  if (type == "VEC3") return 3;
  if (type == "VEC4" || type == "MAT2") return 4;
  if (type == "MAT3") return 9;
  if (type == "MAT4") return 16;
  place.fail("unknown type '" + type.substr(0, 20) + "'");
}

// @param count > 0 elements of `element` bytes every `stride` bytes from `offset` must end inside the view
void check_range(const JsonPlace& place, const Document& document, int view, std::uint64_t offset, std::uint64_t stride,
                 std::uint64_t element, std::uint64_t count) {
  const std::size_t available = document.views[static_cast<std::size_t>(view)].bytes.size();
  // count ≤ 2^31 and stride ≤ 2^16 keep this inside 64 bits.
  const std::uint64_t end = offset + (count - 1) * stride + element;
  if (end > available) {
    place.fail(std::to_string(count) + " elements need " + std::to_string(end) + " bytes, bufferView " +
               std::to_string(view) + " has " + std::to_string(available));
  }
}

void parse_sparse(const JsonPlace& sparse, Document& document, Accessor& accessor) {
  Accessor::Sparse& out = accessor.sparse;
  out.count = sparse.at("count").integer(1, std::max<std::size_t>(accessor.count, 1));
  const JsonPlace indices = sparse.at("indices"), values = sparse.at("values");
  out.index_view = indices.index("bufferView", document.views.size(), "bufferView");
  out.index_offset = indices.integer_or("byteOffset", 0, kMostBufferBytes);
  out.index_component = component_of(indices.at("componentType"));
  if (out.index_component != Component::kU8 && out.index_component != Component::kU16 &&
      out.index_component != Component::kU32) {
    indices.at("componentType").fail("sparse indices must be unsigned integers");
  }
  out.value_view = values.index("bufferView", document.views.size(), "bufferView");
  out.value_offset = values.integer_or("byteOffset", 0, kMostBufferBytes);
  const std::size_t index_size = component_size(out.index_component);
  check_range(indices, document, out.index_view, out.index_offset, index_size, index_size, out.count);
  const std::size_t size = element_size(accessor.type, accessor.component);
  check_range(values, document, out.value_view, out.value_offset, size, size, out.count);
}

}  // namespace

std::size_t component_size(Component component) {
  switch (component) {
    case Component::kI8:
    case Component::kU8:
      return 1;
    case Component::kI16:
    case Component::kU16:
      return 2;
    case Component::kU32:
    case Component::kF32:
      return 4;
  }
  return 4;
}

std::size_t element_size(const std::string& type, Component component) {
  const std::size_t size = component_size(component);
  const auto padded = [](std::size_t bytes) { return (bytes + 3) / 4 * 4; };
  if (type == "MAT2") return 2 * padded(2 * size);
  if (type == "MAT3") return 3 * padded(3 * size);
  if (type == "MAT4") return 16 * size;
  return size * (type == "SCALAR" ? 1 : static_cast<std::size_t>(type[3] - '0'));
}

void parse_accessors(const JsonPlace& root, const ImportOptions& options, Document& document) {
  const auto list = root.find("accessors");
  // An accessor without data costs a file nothing, so its size is bounded by what an asset may have.
  const std::uint64_t most = std::min<std::uint64_t>(
      std::max<std::uint64_t>({options.max_vertices, 3 * std::min<std::uint64_t>(options.max_faces, 1 << 29), 1024}),
      0x7FFFFFFF);
  for (std::size_t i = 0; list && i < list->size(); ++i) {
    const JsonPlace place = (*list)[i];
    Accessor accessor;
    accessor.pointer = place.pointer();
    accessor.component = component_of(place.at("componentType"));
    accessor.width = width_of(place.at("type"));
    accessor.type = place.at("type").string();
    accessor.normalized = place.boolean_or("normalized", false);
    const std::uint64_t count = place.at("count").integer(0, ~std::uint64_t{0});
    if (count > most) {
      place.at("count").fail(std::to_string(count) + " elements exceed the limit of " + std::to_string(most));
    }
    accessor.count = static_cast<std::size_t>(count);
    accessor.offset = place.integer_or("byteOffset", 0, kMostBufferBytes);
    accessor.view = place.index_or_none("bufferView", document.views.size(), "bufferView");
    const std::size_t element = element_size(accessor.type, accessor.component);
    accessor.stride = element;
    if (accessor.view >= 0) {
      const std::size_t stride = document.views[static_cast<std::size_t>(accessor.view)].stride;
      if (stride != 0 && stride < element) {
        place.fail("the bufferView's byteStride " + std::to_string(stride) + " is smaller than an element of " +
                   std::to_string(element) + " bytes");
      }
      if (stride != 0) accessor.stride = stride;
      if (count > 0)
        check_range(place, document, accessor.view, accessor.offset, accessor.stride, element, accessor.count);
    }
    if (const auto sparse = place.find("sparse")) parse_sparse(*sparse, document, accessor);
    document.accessors.push_back(std::move(accessor));
  }
}

}  // namespace anigen::io::gltf_import
