#pragma once
#include <cstdint>
#include <vector>

#include "anigen/rig/binding/moving_bones.h"
#include "anigen/rig/binding/surface_parts.h"

namespace anigen::rig {

/// The joints whose bones are nearest to a place as the surface faces, and whether they warm it.
struct HeatSource {
  double distance = 0.0;             ///< unit frame, to the nearest of them
  std::vector<std::int32_t> joints;  ///< ascending: all whose measure is within a factor 1.0001 of the least
  std::vector<bool> visible;         ///< of each
};

/// What warms each place (reference anymate-baselines.md, 9.2, stage 10): of its nearest joints those that it sees.
/// Nearest is not by distance alone, as published: distances are divided by (1 + cos) / 2 of the angle between the
/// place's normal and the way from the bone, so that of two bones that lie about as near the one below the surface wins
/// over the one before it, such as the arm that hangs beside a hip. To see a bone is that the straight line to the
/// nearest point of the bone meets the surface nowhere but within 0.002 of the place or of that point, and comes to the
/// place from inside, at less than 60° to its normal. On sheets, which have no inside, the side does not matter. The
/// made-up bone of a joint without children ends where it leaves the body. Rays are cast by Embree; runs on all
/// threads. @return [P] @pre surface.has_extent
std::vector<HeatSource> heat_sources(const WeldedSurface& surface, const SurfaceParts& parts,
                                     std::vector<MovingBones> bones);

}  // namespace anigen::rig
