#include "anigen/raytrace/hidden_faces.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "anigen/geometry/face_sets.h"

namespace anigen::raytrace {

VisibleMesh remove_hidden_faces(const Mesh& mesh, const HiddenFaceRemoval& options) {
  const std::vector<float> visibility = face_visibility(mesh, options.views);
  VisibleMesh result;
  if (std::find(visibility.begin(), visibility.end(), 0.0f) == visibility.end()) {
    result.mesh = mesh;
    return result;
  }
  geometry::FaceMarks kept = geometry::hidden_faces(mesh.vertices, mesh.faces, visibility, options.rules);
  for (char& mark : kept) mark = mark == 0;
  const Mesh visible = geometry::chosen_faces(mesh.vertices, mesh.faces, kept);
  result.removed = mesh.faces.size() - visible.faces.size();
  geometry::FilledMesh filled = geometry::fill_holes(visible.vertices, visible.faces, options.holes);
  result.filled_holes = filled.filled;
  result.open_holes = filled.left_open + filled.broken;
  result.mesh = std::move(filled.mesh);
  return result;
}

}  // namespace anigen::raytrace
