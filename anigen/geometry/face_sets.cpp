#include "anigen/geometry/face_sets.h"

#include <algorithm>
#include <iterator>

#include "anigen/core/numeric.h"

namespace anigen::geometry {

std::vector<Triangle> proper_faces(const std::vector<Triangle>& faces) {
  std::vector<Triangle> result;
  result.reserve(faces.size());
  std::copy_if(faces.begin(), faces.end(), std::back_inserter(result),
               [](const Triangle& face) { return face[0] != face[1] && face[1] != face[2] && face[2] != face[0]; });
  return result;
}

std::vector<std::vector<std::int32_t>> face_components(const MeshEdges& edges, std::size_t faces,
                                                       const FaceMarks& chosen) {
  FaceMarks waiting = chosen.empty() ? FaceMarks(faces, 1) : chosen;
  std::vector<std::vector<std::int32_t>> components;
  for (std::size_t start = 0; start < faces; ++start) {
    if (waiting[start] == 0) continue;
    waiting[start] = 0;
    std::vector<std::int32_t> component{static_cast<std::int32_t>(start)};
    for (std::size_t next = 0; next < component.size(); ++next) {
      for (std::size_t side = 0; side < 3; ++side) {
        const std::int32_t edge = edges.of_face(at(component[next]), side);
        if (edge < 0) continue;
        for (const std::int32_t face : edges.faces(at(edge))) {
          if (waiting[at(face)] == 0) continue;
          waiting[at(face)] = 0;
          component.push_back(face);
        }
      }
    }
    std::sort(component.begin(), component.end());
    components.push_back(std::move(component));
  }
  return components;
}

Mesh chosen_faces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                  const FaceMarks& chosen) {
  constexpr std::int32_t kUnused = -1;
  Mesh mesh;
  std::vector<std::int32_t> place(vertices.size(), kUnused);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    if (chosen[f] == 0) continue;
    mesh.faces.push_back(faces[f]);
    for (const std::int32_t vertex : faces[f]) place[at(vertex)] = 0;
  }
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (place[v] == kUnused) continue;
    place[v] = static_cast<std::int32_t>(mesh.vertices.size());
    mesh.vertices.push_back(vertices[v]);
  }
  for (Triangle& face : mesh.faces) {
    for (std::int32_t& vertex : face) vertex = place[at(vertex)];
  }
  return mesh;
}

}  // namespace anigen::geometry
