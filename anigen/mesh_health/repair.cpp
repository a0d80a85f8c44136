#include "anigen/mesh_health/repair.h"

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
  move_apart(result.mesh);
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
