#pragma once
#include <vector>

#include "anigen/raytrace/views/view_plan.h"

namespace anigen::raytrace {

/// The cameras of the published previews and training snapshots. They measure yaw from +Y towards +X, so that the eye
/// is at radius · (sin yaw cos pitch, cos yaw cos pitch, sin pitch): the angles returned here are those. Pass them
/// through from_preview() before anything else of this folder sees them. (Reference training-and-data.md, 1.1.)
ViewCamera from_preview(const ViewCamera& preview);

/// One turn with the camera rising and sinking: yaw from 0 to 2 · 3.1415 (the published constant), both ends included,
/// pitch 0.25 + 0.5 sin(yaw); radius 2, field of view 40°. @throws InputError when frames is 0
std::vector<ViewCamera> preview_turn(std::size_t frames);

/// Four sides from slightly above: yaw −16°, 74°, 164°, 254°, pitch 20°; radius 2, field of view 40°.
std::vector<ViewCamera> snapshot_views();

}  // namespace anigen::raytrace
