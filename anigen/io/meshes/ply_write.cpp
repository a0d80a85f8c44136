#include <algorithm>
#include <cmath>
#include <cstring>

#include "anigen/core/atomic_file.h"
#include "anigen/io/meshes/mesh_check.h"
#include "anigen/io/ply.h"

namespace anigen::io {
namespace {

// Least significant byte first, whatever the machine.
void append_uint32(std::string& bytes, std::uint32_t value) {
  for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<char>(value >> shift & 0xFF));
}

void append_float(std::string& bytes, float value) {
  std::uint32_t bits;
  static_assert(sizeof(bits) == sizeof(value));
  std::memcpy(&bits, &value, sizeof(bits));
  append_uint32(bytes, bits);
}

std::string header(const Mesh& mesh) {
  std::string text = "ply\nformat binary_little_endian 1.0\ncomment AniGen in C++\n";
  text += "element vertex " + std::to_string(mesh.vertices.size()) + "\n";
  for (const char* name : {"x", "y", "z"}) text += std::string("property float ") + name + "\n";
  if (!mesh.normals.empty()) text += "property float nx\nproperty float ny\nproperty float nz\n";
  if (!mesh.uvs.empty()) text += "property float s\nproperty float t\n";
  if (!mesh.colors.empty()) {
    for (const char* name : {"red", "green", "blue", "alpha"}) text += std::string("property uchar ") + name + "\n";
  }
  if (!mesh.faces.empty()) {
    text += "element face " + std::to_string(mesh.faces.size()) + "\nproperty list uchar int vertex_indices\n";
  }
  return text + "end_header\n";
}

}  // namespace

void write_ply(const std::filesystem::path& path, const Mesh& mesh) {
  refuse_unsound_mesh(mesh, path.string());
  std::string bytes = header(mesh);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    for (const float x : mesh.vertices[v]) append_float(bytes, x);
    if (!mesh.normals.empty()) {
      for (const float x : mesh.normals[v]) append_float(bytes, x);
    }
    if (!mesh.uvs.empty()) {
      append_float(bytes, mesh.uvs[v].x());
      append_float(bytes, 1.0f - mesh.uvs[v].y());
    }
    if (!mesh.colors.empty()) {
      for (const float x : mesh.colors[v]) {
        bytes.push_back(static_cast<char>(std::lround(255.0f * std::clamp(x, 0.0f, 1.0f))));
      }
    }
  }
  for (const Triangle& face : mesh.faces) {
    bytes.push_back(3);
    for (const std::int32_t v : face) append_uint32(bytes, static_cast<std::uint32_t>(v));
  }
  write_file_atomically(path, bytes);
}

}  // namespace anigen::io
