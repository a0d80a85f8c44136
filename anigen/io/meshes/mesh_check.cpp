#include "anigen/io/meshes/mesh_check.h"

#include <limits>

#include "anigen/core/error.h"

namespace anigen::io {
namespace {

template <typename Vector>
void check_array(const std::vector<Vector>& array, const char* name, std::size_t vertices, const std::string& file) {
  if (!array.empty() && array.size() != vertices) {
    throw InputError(file, "",
                     std::string("mesh has ") + std::to_string(array.size()) + " " + name + " for " +
                         std::to_string(vertices) + " vertices");
  }
  for (std::size_t i = 0; i < array.size(); ++i) {
    if (!array[i].allFinite())
      throw InputError(file, "", std::string(name) + "[" + std::to_string(i) + "] is not finite");
  }
}

}  // namespace

void refuse_unsound_mesh(const Mesh& mesh, const std::string& file) {
  const std::size_t count = mesh.vertices.size();
  if (count == 0) throw InputError(file, "", "mesh has no vertices to write");
  face_index(count, file);
  check_array(mesh.vertices, "vertices", count, file);
  check_array(mesh.normals, "normals", count, file);
  check_array(mesh.uvs, "uvs", count, file);
  check_array(mesh.colors, "colors", count, file);
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const std::int32_t v : mesh.faces[f]) {
      if (v >= 0 && static_cast<std::size_t>(v) < count) continue;
      throw InputError(
          file, "",
          "faces[" + std::to_string(f) + "] refers to vertex " + std::to_string(v) + " of " + std::to_string(count));
    }
  }
}

Eigen::Vector3f unit_normal(const Eigen::Vector3f& normal) {
  const Eigen::Vector3d n = normal.cast<double>();
  const double length = n.norm();
  return length > 1e-30 ? Eigen::Vector3f((n / length).cast<float>()) : Eigen::Vector3f(Eigen::Vector3f::UnitZ());
}

std::int32_t face_index(std::size_t index, const std::string& file) {
  if (index > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max())) {
    throw InputError(file, "", "mesh has more than 2^31 - 1 vertices");
  }
  return static_cast<std::int32_t>(index);
}

}  // namespace anigen::io
