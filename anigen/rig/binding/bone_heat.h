#pragma once
#include <cstddef>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"

namespace anigen::rig {

struct BoneHeatOptions {
  double heat = 1.0;                ///< c > 0: higher makes weights change faster from bone to bone
  std::size_t most_influences = 4;  ///< per vertex, 0 for all
};

/// Bone heat weights (Baran and Popović, "Automatic rigging and animation of 3D characters", 2007; reference
/// anymate-baselines.md, 9.2, stage 10): what is left of the warmth of each bone when its heat has spread over the
/// surface and come to rest,
///
///     (−Δ + H) w_j = H p_j,   H = c / d² where the nearest bone, at distance d, is seen, else 0,
///
/// with p_j the share of joint j among the nearest ones. Δ is the cotangent Laplacian of the surface with vertices at
/// one position joined; who sees what, heat_sources() says. Then weights are cut off at 0 and 1, those below 1e-8
/// dropped, and rows divided by their sum. All lengths count in units of the mesh's longest side.
///
/// The paper wants one closed surface with all bones inside. For others: a vertex takes a hundredth of the heat of a
/// nearest bone that it does not see, so that what is far from all visible bones gets the weights of the nearest one. A
/// part of the surface of which less than a tenth sees a bone (clothes over a body, a part outside all bones, a vertex
/// without faces) is warmed by its nearest bones as if all of it saw them. Without any extent each vertex is bound to
/// its nearest joint.
///
/// One sparse factorisation on one thread (its time grows with the number of vertices to the power 3/2, its memory is
/// about 100 numbers per vertex), then joints in parallel; the result does not depend on the number of threads.
/// @return [V], at most `most_influences` per row
/// @throws InputError for options out of range, a vertex or joint that is not finite, a bad face, or without joints
SkinWeights bind_by_heat(const Mesh& mesh, const Skeleton& skeleton, const BoneHeatOptions& options = {});

}  // namespace anigen::rig
