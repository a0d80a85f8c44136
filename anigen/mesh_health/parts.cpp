#include "anigen/mesh_health/parts.h"

#include <utility>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/numeric.h"

namespace anigen::mesh_health {

bool runs_upward(const Triangle& face, const MeshEdges::Edge& edge) {
  for (std::size_t k = 0; k < 3; ++k)
    if (face[k] == edge[0]) return face[(k + 1) % 3] == edge[1];
  return false;
}

bool Parts::is_inverted(std::size_t part) const {
  if (closed[part] == 0 || volumes[part] >= 0) return false;
  for (std::size_t other = 0; other < size(); ++other) {
    const bool inside = (boxes[other].low.array() < boxes[part].low.array()).all() &&
                        (boxes[other].high.array() > boxes[part].high.array()).all();
    if (other != part && closed[other] != 0 && inside) return false;
  }
  return true;
}

Parts find_parts(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                 const MeshEdges& edges) {
  DisjointSets sets(faces.size());
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const auto around = edges.faces(e);
    for (const std::int32_t face : around) sets.join_lowest(at(*around.begin()), at(face));
  }
  Parts parts;
  parts.of_face.resize(faces.size());
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const std::size_t first = sets.find(f);
    if (first == f) {
      parts.of_face[f] = parts.size();
      parts.closed.push_back(1);
    } else {
      parts.of_face[f] = parts.of_face[first];
    }
  }
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const auto around = edges.faces(e);
    const bool good = around.size() == 2 && runs_upward(faces[at(around.begin()[0])], edges[e]) !=
                                                runs_upward(faces[at(around.begin()[1])], edges[e]);
    if (!good) parts.closed[parts.of_face[at(*around.begin())]] = 0;
  }
  parts.boxes.resize(parts.size());
  for (std::size_t f = 0; f < faces.size(); ++f)
    for (const std::int32_t v : faces[f]) parts.boxes[parts.of_face[f]].extend(vertices[at(v)].cast<double>());
  parts.volumes.assign(parts.size(), 0.0);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const std::size_t part = parts.of_face[f];
    const auto corner = [&](std::size_t k) -> Eigen::Vector3d {
      return vertices[at(faces[f][k])].cast<double>() - parts.boxes[part].center();
    };
    parts.volumes[part] += corner(0).dot(corner(1).cross(corner(2))) / 6.0;
  }
  return parts;
}

std::size_t turn_outward(Mesh& mesh) {
  const Parts parts = find_parts(mesh.vertices, mesh.faces, MeshEdges(mesh.faces, mesh.vertices.size()));
  std::vector<char> inverted(parts.size(), 0);
  std::size_t count = 0;
  for (std::size_t part = 0; part < parts.size(); ++part) {
    inverted[part] = parts.is_inverted(part);
    count += inverted[part] != 0;
  }
  for (std::size_t f = 0; f < mesh.faces.size(); ++f)
    if (inverted[parts.of_face[f]] != 0) std::swap(mesh.faces[f][1], mesh.faces[f][2]);
  return count;
}

}  // namespace anigen::mesh_health
