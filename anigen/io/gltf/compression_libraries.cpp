#include <draco/compression/decode.h>
#include <meshoptimizer.h>
#include <memory>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/accessors.h"
#include "anigen/io/gltf/compression.h"

namespace anigen::io::gltf_import {

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
  const std::string_view bytes = document.views[at(primitive.draco_view)].bytes;
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
  result.indices.reserve(3 * std::size_t{mesh->num_faces()});
  for (draco::FaceIndex f(0); f < mesh->num_faces(); ++f) {
    for (const draco::PointIndex& point : mesh->face(f)) result.indices.push_back(point.value());
  }
  for (const auto& [name, id] : primitive.draco_attributes) {
    const draco::PointAttribute* attribute = mesh->GetAttributeByUniqueId(id);
    if (attribute == nullptr) fail(document, primitive, "the Draco data has no attribute " + std::to_string(id));
    const Accessor& accessor = document.accessors[at(primitive.attribute(name))];
    if (accessor.width != static_cast<std::size_t>(attribute->num_components()))
      fail(document, primitive, "attribute " + name.substr(0, 40) + " has another type in the Draco data");
    if (attribute->size() == 0 && result.vertices > 0) fail(document, primitive, "a Draco attribute is empty");
    result.attributes.emplace_back(name, read_attribute(*mesh, *attribute, accessor));
  }
  return result;
}

}  // namespace anigen::io::gltf_import
