#include "anigen/io/gltf/import_meshopt.h"

#include <meshoptimizer.h>

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

}  // namespace anigen::io::gltf_import
