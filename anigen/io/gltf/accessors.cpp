#include "anigen/io/gltf/accessors.h"

#include <draco/compression/decode.h>
#include <meshoptimizer.h>
#include <algorithm>
#include <cstring>

#include "anigen/core/error.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter"
#pragma GCC diagnostic ignored "-Wpedantic"
#endif
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

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

namespace {

constexpr const char* kMeshopt = "EXT_meshopt_compression";

struct Buffer {
  std::string_view bytes;
  bool is_placeholder = false;  // the fallback of a compressed file, which need not exist
};

std::optional<JsonPlace> extension(const JsonPlace& place, const char* name) {
  const auto extensions = place.find("extensions");
  return extensions ? extensions->find(name) : std::nullopt;
}

// Bytes that all buffers and decoded views together may take: a small file must not blow up to any size.
class Budget {
 public:
  explicit Budget(std::uintmax_t bytes) : left_(bytes) {}
  void take(std::uintmax_t bytes, const JsonPlace& place) {
    if (bytes > left_) place.fail("all buffers together exceed the limit of the importer");
    left_ -= bytes;
  }

 private:
  std::uintmax_t left_;
};

Buffer read_buffer(const JsonPlace& place, std::size_t index, const Container& container, const ImportOptions& options,
                   Budget& budget, Document& document) {
  const std::uint64_t length = place.at("byteLength").integer(0, kMostBufferBytes);
  Buffer buffer;
  if (const auto uri = place.find("uri")) {
    Resource resource =
        read_uri(uri->string(), container.folder, container.file, uri->pointer(), options.max_file_bytes);
    budget.take(resource.bytes.size(), place);
    document.storage.push_back(std::make_unique<std::string>(std::move(resource.bytes)));
    buffer.bytes = *document.storage.back();
  } else if (index == 0 && container.has_binary) {
    buffer.bytes = container.binary;
  } else if (extension(place, kMeshopt)) {
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
  const Buffer& buffer = buffers[static_cast<std::size_t>(index)];
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
  Budget budget(options.max_file_bytes < kMostBufferBytes ? 4 * options.max_file_bytes : options.max_file_bytes);
  std::vector<Buffer> buffers;
  if (const auto list = root.find("buffers")) {
    for (std::size_t i = 0; i < list->size(); ++i)
      buffers.push_back(read_buffer((*list)[i], i, container, options, budget, document));
  }
  const auto list = root.find("bufferViews");
  for (std::size_t i = 0; list && i < list->size(); ++i) {
    const JsonPlace place = (*list)[i];
    BufferView view;
    view.stride = place.integer_or("byteStride", 0, 1 << 16);
    if (const auto compressed = extension(place, kMeshopt)) {
      place.index("buffer", buffers.size(), "buffer");
      const std::uint64_t length = place.at("byteLength").integer(1, kMostBufferBytes);
      budget.take(length, place);
      document.storage.push_back(
          std::make_unique<std::string>(decode_meshopt(*compressed, cut(*compressed, buffers), length)));
      view.bytes = *document.storage.back();
      notes.tally("decoded_meshopt", "buffer views decoded from EXT_meshopt_compression");
    } else {
      view.bytes = cut(place, buffers);
    }
    document.views.push_back(view);
  }
}

namespace {

[[noreturn]] void fail(const Document& document, const Primitive& primitive, const std::string& problem) {
  throw InputError(document.file, primitive.pointer + "/extensions/KHR_draco_mesh_compression", problem);
}

// Reads an unsigned LEB128 number; moves `offset` behind it. False at the end of the data.
bool read_varint(std::string_view bytes, std::size_t& offset, std::uint64_t& value) {
  value = 0;
  for (int shift = 0; shift < 35; shift += 7) {
    if (offset >= bytes.size()) return false;
    const auto byte = static_cast<unsigned char>(bytes[offset++]);
    value |= static_cast<std::uint64_t>(byte & 0x7F) << shift;
    if ((byte & 0x80) == 0) return true;
  }
  return false;
}

// Draco allocates what the header claims, so the claim is looked at first (Draco bitstream specification, sections
// 2 and 5: header, then for a mesh the counts). Streams with metadata or of older versions pass unchecked.
void check_claimed_size(const Document& document, const Primitive& primitive, std::string_view bytes,
                        std::size_t max_vertices, std::size_t max_faces) {
  if (bytes.size() < 11 || bytes.substr(0, 5) != "DRACO") fail(document, primitive, "not Draco data");
  if (bytes[7] != 1) fail(document, primitive, "the Draco data is not a triangle mesh");
  const bool current = bytes[5] == 2 && bytes[6] >= 2;
  const bool has_metadata = (static_cast<unsigned char>(bytes[10]) & 0x80) != 0;
  if (!current || has_metadata) return;
  const bool edgebreaker = bytes[8] == 1;
  std::size_t offset = edgebreaker ? 12 : 11;
  std::uint64_t first = 0, second = 0;
  if (!read_varint(bytes, offset, first) || !read_varint(bytes, offset, second))
    fail(document, primitive, "the Draco data ends inside its header");
  const std::uint64_t faces = edgebreaker ? second : first, vertices = edgebreaker ? first : second;
  if (vertices > max_vertices || faces > max_faces)
    fail(document, primitive, "the Draco data claims more vertices or faces than the importer's limit");
}

std::vector<float> read_attribute(const draco::Mesh& mesh, const draco::PointAttribute& attribute,
                                  const Accessor& accessor) {
  const bool normalize = accessor.normalized && !attribute.normalized() && accessor.component != Component::kF32;
  const auto scale = static_cast<float>(normalize ? normalized_scale(accessor.component) : 1.0);
  const std::size_t width = accessor.width;
  std::vector<float> values(mesh.num_points() * width);
  for (draco::PointIndex point(0); point < mesh.num_points(); ++point) {
    float* target = values.data() + point.value() * width;
    attribute.ConvertValue<float>(attribute.mapped_index(point), static_cast<std::int8_t>(width), target);
    for (std::size_t c = 0; c < width; ++c) target[c] *= scale;
  }
  return values;
}

}  // namespace

DracoMesh decode_draco(const Document& document, const Primitive& primitive, std::size_t max_vertices,
                       std::size_t max_faces) {
  const std::string_view bytes = document.views[static_cast<std::size_t>(primitive.draco_view)].bytes;
  check_claimed_size(document, primitive, bytes, max_vertices, max_faces);
  draco::DecoderBuffer buffer;
  buffer.Init(bytes.data(), bytes.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  if (!decoded.ok())
    fail(document, primitive, std::string("the Draco data cannot be decoded: ") + decoded.status().error_msg());
  const std::unique_ptr<draco::Mesh> mesh = std::move(decoded).value();
  if (mesh->num_points() > max_vertices || mesh->num_faces() > max_faces)
    fail(document, primitive, "the Draco data has more vertices or faces than the importer's limit");

  DracoMesh result;
  result.vertices = mesh->num_points();
  result.indices.reserve(3 * mesh->num_faces());
  for (draco::FaceIndex f(0); f < mesh->num_faces(); ++f) {
    for (const draco::PointIndex& point : mesh->face(f)) result.indices.push_back(point.value());
  }
  for (const auto& [name, id] : primitive.draco_attributes) {
    const draco::PointAttribute* attribute = mesh->GetAttributeByUniqueId(id);
    if (attribute == nullptr) fail(document, primitive, "the Draco data has no attribute " + std::to_string(id));
    const Accessor& accessor = document.accessors[static_cast<std::size_t>(primitive.attribute(name))];
    if (accessor.width != static_cast<std::size_t>(attribute->num_components()))
      fail(document, primitive, "attribute " + name.substr(0, 40) + " has another type in the Draco data");
    if (attribute->size() == 0 && result.vertices > 0) fail(document, primitive, "a Draco attribute is empty");
    result.attributes.emplace_back(name, read_attribute(*mesh, *attribute, accessor));
  }
  return result;
}

namespace {

// The library states its preconditions as assertions; EXT_meshopt_compression, section "Specifying compressed
// views" has the same rules.
void check_stride(const JsonPlace& extension, const std::string& mode, const std::string& filter, std::size_t stride) {
  const bool attributes = mode == "ATTRIBUTES";
  if (!attributes && mode != "TRIANGLES" && mode != "INDICES") extension.at("mode").fail("unknown mode '" + mode + "'");
  if (attributes ? stride % 4 != 0 || stride > 256 : stride != 2 && stride != 4)
    extension.at("byteStride").fail("byteStride " + std::to_string(stride) + " is not allowed for mode " + mode);
  if (filter == "NONE") return;
  const bool fits = filter == "OCTAHEDRAL"    ? stride == 4 || stride == 8
                    : filter == "QUATERNION"  ? stride == 8
                    : filter == "EXPONENTIAL" ? stride % 4 == 0
                                              : false;
  if (!attributes || !fits) extension.at("filter").fail("filter '" + filter + "' does not fit mode and byteStride");
}

}  // namespace

std::string decode_meshopt(const JsonPlace& extension, std::string_view source, std::size_t expected) {
  const std::string mode = extension.at("mode").string();
  const std::string filter = extension.string_or("filter", "NONE");
  const std::size_t stride = extension.at("byteStride").integer(1, 256);
  check_stride(extension, mode, filter, stride);
  const std::size_t count = extension.at("count").integer(1, expected);
  if (count * stride != expected) {
    extension.at("count").fail("count · byteStride is " + std::to_string(count * stride) +
                               ", the bufferView has byteLength " + std::to_string(expected));
  }
  // The densest stream spends two bits on sixteen bytes; anything smaller is not worth allocating memory for.
  if (expected / 64 > source.size()) extension.fail("the compressed data is too short for its count");
  if (mode == "TRIANGLES" && count % 3 != 0) extension.at("count").fail("a triangle list needs a multiple of 3");
  std::string result(expected, '\0');
  const auto* data = reinterpret_cast<const unsigned char*>(source.data());
  const int failed =
      mode == "ATTRIBUTES"  ? meshopt_decodeVertexBuffer(result.data(), count, stride, data, source.size())
      : mode == "TRIANGLES" ? meshopt_decodeIndexBuffer(result.data(), count, stride, data, source.size())
                            : meshopt_decodeIndexSequence(result.data(), count, stride, data, source.size());
  if (failed != 0) extension.fail("the meshopt data cannot be decoded (code " + std::to_string(failed) + ")");
  if (filter == "OCTAHEDRAL") meshopt_decodeFilterOct(result.data(), count, stride);
  if (filter == "QUATERNION") meshopt_decodeFilterQuat(result.data(), count, stride);
  if (filter == "EXPONENTIAL") meshopt_decodeFilterExp(result.data(), count, stride);
  return result;
}

}  // namespace anigen::io::gltf_import
