#include "anigen/rig/binding/welded_surface.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::rig {
namespace {

void check_surface(const Mesh& mesh) {
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (mesh.vertices[v].allFinite()) continue;
    throw InputError("", "mesh.vertices[" + std::to_string(v) + "]", "the position is not finite");
  }
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const std::int32_t v : mesh.faces[f]) {
      if (v >= 0 && at(v) < mesh.vertices.size()) continue;
      throw InputError("", "mesh.faces[" + std::to_string(f) + "]", "there is no vertex " + std::to_string(v));
    }
  }
}

/// 0 and −0 are one position.
std::array<float, 3> sortable(const Eigen::Vector3f& p) { return {p.x() + 0.0F, p.y() + 0.0F, p.z() + 0.0F}; }

/// Numbers the positions; places stay in the mesh's frame.
void number_places(const std::vector<Eigen::Vector3f>& vertices, WeldedSurface& surface) {
  std::vector<std::int32_t> order(vertices.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(),
            [&](std::int32_t a, std::int32_t b) { return sortable(vertices[at(a)]) < sortable(vertices[at(b)]); });
  surface.of_vertex.resize(vertices.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    const Eigen::Vector3f& vertex = vertices[at(order[i])];
    if (i == 0 || sortable(vertices[at(order[i - 1])]) != sortable(vertex)) {
      surface.places.push_back(vertex.cast<double>());
    }
    surface.of_vertex[at(order[i])] = static_cast<std::int32_t>(surface.places.size() - 1);
  }
}

/// Lowest corner first, winding kept.
Triangle turned(const Triangle& face) {
  const auto lowest = static_cast<std::size_t>(std::min_element(face.begin(), face.end()) - face.begin());
  return {face[lowest], face[(lowest + 1) % 3], face[(lowest + 2) % 3]};
}

Triangle corner_set(Triangle face) {
  std::sort(face.begin(), face.end());
  return face;
}

std::vector<Triangle> welded_faces(const std::vector<Triangle>& faces, const std::vector<std::int32_t>& of_vertex) {
  std::vector<Triangle> welded;
  welded.reserve(faces.size());
  for (const Triangle& face : faces) {
    const Triangle corners = {of_vertex[at(face[0])], of_vertex[at(face[1])], of_vertex[at(face[2])]};
    if (corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0]) continue;
    welded.push_back(turned(corners));
  }
  std::sort(welded.begin(), welded.end(), [](const Triangle& a, const Triangle& b) {
    const Triangle first = corner_set(a), second = corner_set(b);
    return first != second ? first < second : a < b;
  });
  const auto same = [](const Triangle& a, const Triangle& b) { return corner_set(a) == corner_set(b); };
  welded.erase(std::unique(welded.begin(), welded.end(), same), welded.end());
  return welded;
}

}  // namespace

WeldedSurface weld_surface(const Mesh& mesh) {
  check_surface(mesh);
  WeldedSurface surface;
  number_places(mesh.vertices, surface);
  surface.faces = welded_faces(mesh.faces, surface.of_vertex);
  // Vertices without a face do not count: a stray one far away would leave the rest a fraction of a voxel.
  Box box;
  for (const Triangle& face : surface.faces) {
    for (const std::int32_t place : face) box.extend(surface.places[at(place)]);
  }
  surface.has_extent = box.longest_side() > 0.0;
  if (surface.has_extent) {
    surface.center = box.center();
    surface.size = box.longest_side();
  }
  for (Eigen::Vector3d& place : surface.places) place = surface.to_unit(place);
  return surface;
}

SkinWeights rows_of_vertices(const SkinWeights& rows_of_places, const WeldedSurface& surface) {
  SkinWeights skin;
  skin.offsets.reserve(surface.of_vertex.size() + 1);
  for (const std::int32_t place : surface.of_vertex) {
    const Influence* row = rows_of_places.row(at(place));
    skin.influences.insert(skin.influences.end(), row, row + rows_of_places.row_size(at(place)));
    skin.offsets.push_back(skin.influences.size());
  }
  return skin;
}

}  // namespace anigen::rig
