#include "anigen/mesh_health/repair.h"

#include <algorithm>
#include <string>
#include <unordered_map>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/fill_holes.h"
#include "anigen/mesh_health/clean.h"
#include "anigen/mesh_health/parts.h"
#include "anigen/mesh_health/weld.h"

namespace anigen::mesh_health {

namespace {

/// Turns closed parts over that are wound inward. @return how many
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

/// Moves vertices at the position of earlier ones towards the middle of their own faces, each farther than the one
/// before it.
void move_apart(Mesh& mesh, double distance) {
  std::unordered_map<Eigen::Vector3f, int, PositionHash> count;
  std::vector<int> earlier(mesh.vertices.size(), 0);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) earlier[v] = count[mesh.vertices[v]]++;
  if (std::all_of(earlier.begin(), earlier.end(), [](int n) { return n == 0; })) return;
  std::vector<Eigen::Vector3d> middle(mesh.vertices.size(), Eigen::Vector3d::Zero());
  for (const Triangle& face : mesh.faces) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const std::int32_t v : face) sum += mesh.vertices[at(v)].cast<double>();
    for (const std::int32_t v : face) middle[at(v)] += sum / 3.0 - mesh.vertices[at(v)].cast<double>();
  }
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (earlier[v] == 0 || middle[v].norm() == 0.0) continue;
    const Eigen::Vector3d moved = mesh.vertices[v].cast<double>() + earlier[v] * distance * middle[v].normalized();
    mesh.vertices[v] = moved.cast<float>();
  }
}

}  // namespace

double merge_distance(const Mesh& mesh, const RepairOptions& options) {
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (!mesh.vertices[v].allFinite())
      throw InputError("", "mesh.vertices[" + std::to_string(v) + "]", "the vertex is not finite");
  }
  return options.merge_distance * bounding_box(mesh.vertices).diagonal();
}

Repaired repair(const Mesh& mesh, const RepairOptions& options) {
  const WeldedMesh welded = weld(mesh, merge_distance(mesh, options));
  CleanSurface clean = clean_surface(welded.places, welded.faces);
  if (clean.mesh.faces.empty()) throw Error("nothing is left of the mesh but faces without area");
  Repaired result;
  result.merged_vertices = mesh.vertices.size() - welded.places.size();
  result.isolated_vertices = welded.isolated_vertices;
  result.duplicate_faces = welded.duplicate_faces;
  result.degenerate_faces = welded.collapsed_faces + clean.degenerate_faces;
  result.reversed_faces = clean.reversed_faces;
  result.copied_vertices = clean.copied_vertices;
  result.stitched_edges = clean.stitched_edges;
  result.degenerate_left = clean.degenerate_left;
  std::unordered_map<Eigen::Vector3f, std::int32_t, PositionHash> places;
  for (std::size_t p = 0; p < welded.places.size(); ++p)
    places.try_emplace(welded.places[p], static_cast<std::int32_t>(p));
  for (const Eigen::Vector3f& vertex : clean.mesh.vertices) {
    const auto found = places.find(vertex);
    result.place.push_back(found == places.end() ? -1 : found->second);
  }
  result.mesh = std::move(clean.mesh);
  if (options.fill_edges > 0) {
    geometry::FilledMesh filled =
        geometry::fill_holes(result.mesh.vertices, result.mesh.faces, {options.fill_edges, true});
    result.mesh = std::move(filled.mesh);
    result.filled_holes = filled.filled;
    result.open_holes = filled.left_open + filled.broken;
    result.place.resize(result.mesh.vertices.size(), -1);
  }
  result.turned_parts = turn_outward(result.mesh);
  constexpr double kShareApart = 1e-6;
  move_apart(result.mesh, kShareApart * bounding_box(result.mesh.vertices).diagonal());
  return result;
}

Json to_json(const Repaired& repaired) {
  return {{"vertices", repaired.mesh.vertices.size()},
          {"faces", repaired.mesh.faces.size()},
          {"merged_vertices", repaired.merged_vertices},
          {"isolated_vertices", repaired.isolated_vertices},
          {"duplicate_faces", repaired.duplicate_faces},
          {"degenerate_faces", repaired.degenerate_faces},
          {"degenerate_left", repaired.degenerate_left},
          {"reversed_faces", repaired.reversed_faces},
          {"copied_vertices", repaired.copied_vertices},
          {"stitched_edges", repaired.stitched_edges},
          {"turned_parts", repaired.turned_parts},
          {"filled_holes", repaired.filled_holes},
          {"open_holes", repaired.open_holes}};
}

}  // namespace anigen::mesh_health
