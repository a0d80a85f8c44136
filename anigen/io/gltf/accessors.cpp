#include "anigen/io/gltf/accessors.h"

#include <algorithm>
#include <cstring>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/compression.h"

namespace anigen::io::gltf_import {

namespace {

// Calls `use` with a value of the component's type.
template <typename Use>
auto with_type(Component component, Use use) {
  if (component == Component::kI8) return use(std::int8_t());
  if (component == Component::kU8) return use(std::uint8_t());
  if (component == Component::kI16) return use(std::int16_t());
  if (component == Component::kU16) return use(std::uint16_t());
  return component == Component::kU32 ? use(std::uint32_t()) : use(float());
}

std::size_t size_of(Component component) {
  return with_type(component, [](auto value) { return sizeof value; });
}

// Columns start at multiples of 4 bytes where there are several (glTF 2.0, section 3.6.2.4).
struct ElementType {
  const char* name;
  std::size_t rows, columns;
  std::size_t column_bytes(std::size_t component) const {
    return columns == 1 ? rows * component : (rows * component + 3) / 4 * 4;
  }
};
constexpr ElementType kElementTypes[] = {{"SCALAR", 1, 1}, {"VEC2", 2, 1}, {"VEC3", 3, 1}, {"VEC4", 4, 1},
                                         {"MAT2", 2, 2},   {"MAT3", 3, 3}, {"MAT4", 4, 4}};

// nullptr for an unknown name.
const ElementType* element_type(const std::string& name) {
  const auto* found = std::find_if(std::begin(kElementTypes), std::end(kElementTypes),
                                   [&](const ElementType& type) { return name == type.name; });
  return found == std::end(kElementTypes) ? nullptr : found;
}

std::size_t element_bytes(const Accessor& accessor) {
  const ElementType& type = *element_type(accessor.type);
  return type.columns * type.column_bytes(size_of(accessor.component));
}

template <typename T>
class ElementReader {
 public:
  ElementReader(const Accessor& accessor, bool normalize)
      : accessor_(accessor),
        type_(*element_type(accessor.type)),
        scale_(normalize && accessor.normalized ? normalized_scale(accessor.component) : 1.0) {}

  // Elements of one stored type, `stride` bytes apart. glTF data need not be aligned for the host.
  void read(const char* source, std::size_t stride, std::size_t count, T* target) const {
    with_type(accessor_.component, [&](auto stored) {
      const std::size_t column_bytes = type_.column_bytes(sizeof stored);
      for (std::size_t i = 0; i < count; ++i, source += stride) {
        for (std::size_t column = 0; column < type_.columns; ++column) {
          for (std::size_t row = 0; row < type_.rows; ++row) {
            std::memcpy(&stored, source + column * column_bytes + row * sizeof stored, sizeof stored);
            auto value = static_cast<double>(stored);
            if (scale_ != 1.0) value = std::max(value * scale_, -1.0);
            *target++ = static_cast<T>(value);
          }
        }
      }
    });
  }

 private:
  const Accessor& accessor_;
  const ElementType& type_;
  double scale_;
};

template <typename T>
std::vector<T> read(const Document& document, int index, bool normalize, std::size_t at_most) {
  const Accessor& accessor = document.accessors[at(index)];
  const std::size_t count = std::min(accessor.count, at_most);
  const auto bytes_at = [&](int view, std::size_t offset) { return document.views[at(view)].bytes.data() + offset; };
  const ElementReader<T> reader(accessor, normalize);
  std::vector<T> values(count * accessor.width, T(0));
  if (accessor.view >= 0) reader.read(bytes_at(accessor.view, accessor.offset), accessor.stride, count, values.data());
  const Accessor::Sparse& sparse = accessor.sparse;
  if (sparse.count == 0) return values;
  const char* source = bytes_at(sparse.value_view, sparse.value_offset);
  with_type(sparse.index_component, [&](auto stored) {
    const char* indices = bytes_at(sparse.index_view, sparse.index_offset);
    for (std::size_t i = 0; i < sparse.count; ++i) {
      std::memcpy(&stored, indices + i * sizeof stored, sizeof stored);
      const auto target = static_cast<std::size_t>(stored);
      if (target >= accessor.count) {
        throw InputError(
            document.file, accessor.pointer + "/sparse/indices",
            "sparse index " + std::to_string(target) + " of " + std::to_string(accessor.count) + " elements");
      }
      if (target < count)
        reader.read(source + i * element_bytes(accessor), 0, 1, values.data() + target * accessor.width);
    }
  });
  return values;
}

}  // namespace

double normalized_scale(Component component) {
  return with_type(component, [](auto value) {
    using Stored = decltype(value);
    return std::is_integral_v<Stored> ? 1.0 / static_cast<double>(std::numeric_limits<Stored>::max()) : 1.0;
  });
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

namespace {

Component component_of(const JsonPlace& place) {
  const std::uint64_t code = place.integer(0, 65535);
  if (code < 5120 || code > 5126 || code == 5124) place.fail("unknown componentType " + std::to_string(code));
  return static_cast<Component>(code);
}

// @param count > 0 elements of `element` bytes every `stride` bytes from `offset` must end inside the view
void check_range(const JsonPlace& place, const Document& document, int view, std::uint64_t offset, std::uint64_t stride,
                 std::uint64_t element, std::uint64_t count) {
  const std::size_t available = document.views[at(view)].bytes.size();
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
  if (!is_unsigned(out.index_component)) indices.at("componentType").fail("sparse indices must be unsigned integers");
  out.value_view = values.index("bufferView", document.views.size(), "bufferView");
  out.value_offset = values.integer_or("byteOffset", 0, kMostBufferBytes);
  const std::size_t index_size = size_of(out.index_component), size = element_bytes(accessor);
  check_range(indices, document, out.index_view, out.index_offset, index_size, index_size, out.count);
  check_range(values, document, out.value_view, out.value_offset, size, size, out.count);
}

}  // namespace

void parse_accessors(const JsonPlace& root, const ImportOptions& options, Document& document) {
  // An accessor without data costs a file nothing, so its size is bounded by what an asset may have.
  const std::uint64_t most = std::min<std::uint64_t>(
      std::max<std::uint64_t>({options.max_vertices, 3 * std::min<std::uint64_t>(options.max_faces, 1 << 29), 1024}),
      0x7FFFFFFF);
  for (const JsonPlace& place : root.entries("accessors")) {
    Accessor accessor;
    accessor.pointer = place.pointer();
    accessor.component = component_of(place.at("componentType"));
    accessor.type = place.at("type").string();
    const ElementType* type = element_type(accessor.type);
    if (type == nullptr) place.at("type").fail("unknown type '" + accessor.type.substr(0, 20) + "'");
    accessor.width = type->rows * type->columns;
    accessor.normalized = place.boolean_or("normalized", false);
    const std::uint64_t count = place.at("count").integer(0, ~std::uint64_t{0});
    if (count > most)
      place.at("count").fail(std::to_string(count) + " elements exceed the limit of " + std::to_string(most));
    accessor.count = static_cast<std::size_t>(count);
    accessor.offset = place.integer_or("byteOffset", 0, kMostBufferBytes);
    accessor.view = place.index_or_none("bufferView", document.views.size(), "bufferView");
    const std::size_t element = element_bytes(accessor);
    accessor.stride = element;
    if (accessor.view >= 0) {
      const std::size_t stride = document.views[at(accessor.view)].stride;
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

namespace {

constexpr const char* kMeshopt = "EXT_meshopt_compression";

struct Buffer {
  std::string_view bytes;
  bool is_placeholder = false;  // the fallback of a compressed file, which need not exist
};

// Bytes that all buffers and decoded views together may take: a small file must not blow up to any size.
struct Budget {
  std::uintmax_t left;
  void take(std::uintmax_t bytes, const JsonPlace& place) {
    if (bytes > left) place.fail("all buffers together exceed the limit of the importer");
    left -= bytes;
  }
};

Buffer read_buffer(const JsonPlace& place, std::size_t index, const Container& container, const ImportOptions& options,
                   Budget& budget, Document& document) {
  const std::uint64_t length = place.at("byteLength").integer(0, kMostBufferBytes);
  Buffer buffer;
  if (const auto uri = place.find("uri")) {
    std::string bytes =
        read_uri(uri->string(), container.folder, container.file, uri->pointer(), options.max_file_bytes);
    budget.take(bytes.size(), place);
    buffer.bytes = document.keep(std::move(bytes));
  } else if (index == 0 && container.has_binary) {
    buffer.bytes = container.binary;
  } else if (place.extension(kMeshopt)) {
    buffer.is_placeholder = true;
    return buffer;
  } else {
    place.fail("the buffer has no uri, and there is no binary chunk for it");
  }
  if (buffer.bytes.size() < length) {
    place.at("byteLength")
        .fail("the buffer should have " + std::to_string(length) + " bytes but has only " +
              std::to_string(buffer.bytes.size()) + ": truncated data");
  }
  buffer.bytes = buffer.bytes.substr(0, length);
  return buffer;
}

// The bytes that "buffer", "byteOffset", "byteLength" of a view (or of its compressed form) name.
std::string_view cut(const JsonPlace& place, const std::vector<Buffer>& buffers) {
  const int index = place.index("buffer", buffers.size(), "buffer");
  const Buffer& buffer = buffers[at(index)];
  if (buffer.is_placeholder) place.at("buffer").fail("the buffer has no data");
  const std::uint64_t offset = place.integer_or("byteOffset", 0, kMostBufferBytes);
  const std::uint64_t length = place.at("byteLength").integer(0, kMostBufferBytes);
  if (offset + length > buffer.bytes.size()) {
    place.fail("bytes " + std::to_string(offset) + " to " + std::to_string(offset + length) + " lie outside buffer " +
               std::to_string(index) + " of " + std::to_string(buffer.bytes.size()) + " bytes");
  }
  return buffer.bytes.substr(offset, length);
}

}  // namespace

void parse_buffers(const JsonPlace& root, const Container& container, const ImportOptions& options, Document& document,
                   Notes& notes) {
  Budget budget{options.max_file_bytes < kMostBufferBytes ? 4 * options.max_file_bytes : options.max_file_bytes};
  std::vector<Buffer> buffers;
  for (const JsonPlace& place : root.entries("buffers"))
    buffers.push_back(read_buffer(place, buffers.size(), container, options, budget, document));
  for (const JsonPlace& place : root.entries("bufferViews")) {
    BufferView view;
    view.stride = place.integer_or("byteStride", 0, 1 << 16);
    if (const auto compressed = place.extension(kMeshopt)) {
      place.index("buffer", buffers.size(), "buffer");
      const std::uint64_t length = place.at("byteLength").integer(1, kMostBufferBytes);
      budget.take(length, place);
      view.bytes = document.keep(decode_meshopt(*compressed, cut(*compressed, buffers), length));
      notes.tally("decoded_meshopt", "buffer views decoded from EXT_meshopt_compression");
    } else {
      view.bytes = cut(place, buffers);
    }
    document.views.push_back(view);
  }
}

}  // namespace anigen::io::gltf_import
