#pragma once
#include <cstddef>
#include <functional>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::raytrace {

struct VisibilityViews {
  std::size_t views = 1000;
  int size = 1024;  ///< pixels on a side, 1 … 16384

  /// Called with the number of finished views, from any thread, one call at a time.
  std::function<void(std::size_t done)> progress;
};

/// In what share of views around it each face shows in at least one pixel [F] (reference flows-and-pipeline.md, 5.8):
/// pinhole cameras at distance 2 from the origin in the directions of the Hammersley set, looking at it, field of view
/// 40°, depths from 1 to 3. A pixel shows the face that its centre's ray meets first, either side of it; of equally
/// near faces the first. Faces too small to cover a pixel's centre go unseen: what that means is for the caller to
/// judge.
///
/// By a depth buffer per thread (8 bytes per pixel), whose edges have no gaps: no ray slips between two faces that
/// share vertices. Runs on all threads; the result does not depend on them.
/// @param mesh in the unit cube around the origin, as generated meshes are
/// @throws InputError without views, on a bad size or vertex index, or on a vertex that is not finite
std::vector<float> face_visibility(const Mesh& mesh, const VisibilityViews& options = {});

}  // namespace anigen::raytrace
