#pragma once
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/image.h"
#include "anigen/tracking/track.h"

namespace anigen::tracking {

/// One tracked pose under its frame's camera and light, as the objective sees it but four rays a pixel; transparent
/// beside the rig. @param n of poses
io::Image tracked_picture(const RigTensors& rig, const TrackedPoses& poses, std::size_t n, const PinholeCamera& camera,
                          int size);

/// Frames of a video, below each the rig as it was tracked, and below that the same pose from a quarter turn aside,
/// where errors of depth show. Eight moments spread over the video.
/// @param asset in the rig's frame @param clip clip_of() for it at `fps` @throws InputError as render::render()
io::Image comparison_sheet(const Asset& asset, const RigTensors& rig, const std::vector<TrackedFrame>& frames,
                           const TrackedPoses& poses, const Animation& clip, double fps);

}  // namespace anigen::tracking
