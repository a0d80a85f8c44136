#pragma once
#include <cstddef>
#include <functional>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/fill_holes.h"
#include "anigen/geometry/hidden_faces.h"

namespace anigen::render {

struct VisibilityViews {
  std::size_t views = 1000;
  int size = 1024;  ///< pixels on a side, 1 … 16384

  /// Called with the number of finished views, from any thread, one call at a time.
  std::function<void(std::size_t done)> progress;
};

/// In what share of views around it each face shows in at least one pixel [F] (docs/reference/flows.md, 5.6): pinhole
/// cameras at distance 2 from the origin in the directions of the Hammersley set, looking at it, field of view 40°,
/// depths from 1 to 3. A pixel shows the face that its centre's ray meets first, either side of it; of equally near
/// faces the first. Faces too small to cover a pixel's centre go unseen: what that means is for the caller to judge.
///
/// By a depth buffer per thread (8 bytes per pixel), whose edges have no gaps: no ray slips between two faces that
/// share vertices. Runs on all threads; the result does not depend on them.
/// @param mesh in the unit cube around the origin, as generated meshes are
/// @throws InputError without views, on a bad size or vertex index, or on a vertex that is not finite
std::vector<float> face_visibility(const Mesh& mesh, const VisibilityViews& options = {});

/// docs/reference/flows.md, 5.6, with its constants.
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

}  // namespace anigen::render
