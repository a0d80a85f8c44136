#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/rigging/surface.h"

namespace anigen::rigging {

/// Rules by which bones warm places of a surface.
enum class HeatForm {
  kPublished,  ///< Baran and Popović 2007 with their program's angles (docs/reference/riggers.md, 2, step 10)
  kBlender,    ///< as Blender's automatic weights count, but for weights below 0.05, which Blender fades out
};

/// The joints whose bones are nearest to a place as the surface faces, and whether they warm it.
struct HeatSource {
  double distance = 0.0;  ///< unit frame, to the nearest of them
  double measure = 0.0;   ///< that distance over (1 + cos) / 2: longer where the bone lies before the surface
  std::vector<std::int32_t> joints;  ///< ascending: all whose measure is within a factor 1.0001 of the least
  std::vector<bool> visible;         ///< of each
};

/// Heat sources of each point (docs/reference/riggers.md, 2, step 10): of its nearest joints those that it sees.
/// Nearest is not by distance alone, as published: distances are divided by (1 + cos) / 2 of the angle between the
/// place's normal and the way from the bone, so that of two bones that lie about as near the one below the surface wins
/// over the one before it, such as the arm that hangs beside a hip. To see a bone is that the straight line to the
/// nearest point of the bone meets the surface nowhere but within 0.002 of the place or of that point, and comes to the
/// place from inside, at less than 60° to its normal. On sheets, which have no inside, the side does not matter. The
/// made-up bone of a joint without children ends where it leaves the body.
///
/// As Blender counts, a bone is hidden by faces alone that the way from the place to it meets from their front: leaving
/// a body hides nothing, entering another one does. Angles do not matter, sheets have the side that their winding
/// gives, and made-up bones keep their length. Rays are cast by Embree; runs on all threads.
/// @return [P] @pre surface.has_extent
std::vector<HeatSource> heat_sources(const WeldedSurface& surface, const SurfaceParts& parts,
                                     std::vector<MovingBones> bones, HeatForm form = HeatForm::kPublished);

struct BoneHeatOptions {
  double heat = 1.0;  ///< c > 0: higher makes weights change faster from bone to bone
  HeatForm form = HeatForm::kPublished;
  std::size_t most_influences = 4;  ///< per vertex, 0 for all
};

/// Heat that comes nearer to the weights of artists than the published constants (docs/results.md, classical riggers):
/// HeatForm::kBlender with c = 4. Blender's own constant is 1, its Laplacian a quarter of −Δ.
BoneHeatOptions fitted_heat(std::size_t most_influences);

/// Bone heat weights (Baran and Popović, "Automatic rigging and animation of 3D characters", 2007;
/// docs/reference/riggers.md, 2, step 10): what is left of the warmth of each bone when its heat has spread over the
/// surface and come to rest,
///
///     (−Δ + H) w_j = H p_j,   H = c / d² where the nearest bone, at distance d, is seen, else 0,
///
/// (as Blender counts with the distance as the surface faces for d) with p_j the share of joint j among the nearest
/// ones. Δ is the cotangent Laplacian of the surface with vertices at one position joined; who sees what,
/// heat_sources() says. Then weights are cut off at 0 and 1, those below 1e-8 dropped, and rows divided by their sum.
/// All lengths count in units of the mesh's longest side.
///
/// The paper wants one closed surface with all bones inside. For others: a vertex takes a hundredth of the heat of a
/// nearest bone that it does not see, so that what is far from all visible bones gets the weights of the nearest one. A
/// part of the surface of which less than a tenth sees a bone (clothes over a body, a part outside all bones, a vertex
/// without faces) is warmed by its nearest bones as if all of it saw them, but not as Blender counts. Without any
/// extent each vertex is bound to its nearest joint.
///
/// One sparse factorisation on one thread (its time grows with the number of vertices to the power 3/2, its memory is
/// about 100 numbers per vertex), then joints in parallel; the result does not depend on the number of threads.
/// @return [V], at most `most_influences` per row
/// @throws InputError for options out of range, a vertex or joint that is not finite, a bad face, or without joints
SkinWeights bind_by_heat(const Mesh& mesh, const Skeleton& skeleton, const BoneHeatOptions& options = {});

}  // namespace anigen::rigging
