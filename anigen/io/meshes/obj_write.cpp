#include <algorithm>
#include <string>

#include "anigen/core/atomic_file.h"
#include "anigen/io/meshes/mesh_check.h"
#include "anigen/io/meshes/number_text.h"
#include "anigen/io/obj.h"

namespace anigen::io {
namespace {

template <typename Vector>
void append_line(std::string& text, const char* keyword, const Vector& numbers) {
  text += keyword;
  for (Eigen::Index k = 0; k < numbers.size(); ++k) {
    text += ' ';
    append_number(text, numbers[k]);
  }
  text += '\n';
}

void append_vertices(std::string& text, const Mesh& mesh) {
  const bool transparent = std::any_of(mesh.colors.begin(), mesh.colors.end(),
                                       [](const Eigen::Vector4f& color) { return color.w() != 1.0f; });
  Eigen::VectorXf numbers(mesh.colors.empty() ? 3 : transparent ? 7 : 6);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    numbers.head<3>() = mesh.vertices[v];
    if (!mesh.colors.empty()) numbers.tail(numbers.size() - 3) = mesh.colors[v].head(numbers.size() - 3);
    append_line(text, "v", numbers);
  }
}

}  // namespace

void write_obj(const std::filesystem::path& path, const Mesh& mesh) {
  refuse_unsound_mesh(mesh, path.string());
  std::string text = "# AniGen in C++\n";
  append_vertices(text, mesh);
  for (const Eigen::Vector2f& uv : mesh.uvs) {
    // In double precision, so that turning v back on reading gives the same float.
    append_line(text, "vt", Eigen::Vector2d(uv.x(), 1.0 - static_cast<double>(uv.y())));
  }
  for (const Eigen::Vector3f& normal : mesh.normals) append_line(text, "vn", normal);
  for (const Triangle& face : mesh.faces) {
    text += 'f';
    for (const std::int32_t v : face) {
      const std::string index = std::to_string(v + std::int64_t{1});
      text += ' ' + index;
      if (!mesh.uvs.empty()) text += '/' + index;
      if (!mesh.normals.empty()) text += (mesh.uvs.empty() ? "//" : "/") + index;
    }
    text += '\n';
  }
  write_file_atomically(path, text);
}

}  // namespace anigen::io
