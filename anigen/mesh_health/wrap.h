#pragma once
#include <cstddef>

#include "anigen/asset/mesh.h"
#include "anigen/mesh_health/limited.h"

namespace anigen::mesh_health {

struct WrapOptions {
  double alpha = 0.02;                 ///< share of the box's diagonal: balls of this radius do not pass holes and gaps
  double offset = 0.0;                 ///< share of the diagonal by which the wrap stands off; 0: a thirtieth of alpha
  std::size_t most_faces = 2'000'000;  ///< refuse, or give up, beyond
};

/// Faces that wrap() would give: those of a coarse wrap times the square of how much finer alpha is. A finer ball also
/// enters cavities that a coarse one does not see, so that there may be more.
/// @throws InputError as wrap(), Interrupted
std::size_t estimated_wrap_faces(const Mesh& mesh, const WrapOptions& options);

/// A closed manifold that encloses everything the mesh has, whatever is wrong with it: a ball of radius alpha is rolled
/// from outside (Portaneri et al. 2022, CGAL's package Alpha_wrap_3). Sheets become thin solids, parts that touch
/// become one, what is inside goes, and sharp edges are rounded off by about the offset. On the calling thread.
/// @param report vertices inserted, of those expected @return vertices and faces alone
/// @throws InputError for a mesh without faces or without extent, one that is not finite, shares out of range, or when
/// there would be more than `most_faces`; Error when CGAL gives up; Interrupted
Mesh wrap(const Mesh& mesh, const WrapOptions& options = {}, const StepReport& report = {});

}  // namespace anigen::mesh_health
