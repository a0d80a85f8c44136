#pragma once
#include <cstddef>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/fill_holes.h"
#include "anigen/geometry/hidden_faces.h"
#include "anigen/raytrace/face_visibility.h"

namespace anigen::raytrace {

/// Reference flows-and-pipeline.md, 5.8, with its constants.
struct HiddenFaceRemoval {
  VisibilityViews views;
  geometry::HiddenFaceRules rules;
  geometry::HoleFilling holes;
};

struct VisibleMesh {
  Mesh mesh;                     ///< vertices and faces alone; the one given, when every face is seen
  std::size_t removed = 0;       ///< faces
  std::size_t filled_holes = 0;  ///< of those that were there before, too
  std::size_t open_holes = 0;    ///< borders left, longer than what is filled
};

/// Takes away faces inside a mesh, which a generator leaves behind and nobody sees, and closes small holes. As
/// published, a mesh of which every face is seen comes back as it is, with its holes and all its arrays.
/// @param mesh in the unit cube around the origin
/// @throws InputError as face_visibility
VisibleMesh remove_hidden_faces(const Mesh& mesh, const HiddenFaceRemoval& options = {});

}  // namespace anigen::raytrace
