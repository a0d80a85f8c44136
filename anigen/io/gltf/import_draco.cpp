#include "anigen/io/gltf/import_draco.h"

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter"
#pragma GCC diagnostic ignored "-Wpedantic"
#endif
#include <draco/compression/decode.h>
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

#include "anigen/core/error.h"
#include "anigen/io/gltf/import_accessor.h"

namespace anigen::io::gltf_import {
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

}  // namespace anigen::io::gltf_import
