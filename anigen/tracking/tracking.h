#pragma once
/// Poses of a rig from a video: silhouettes and colours, compared through the differentiable rasteriser.
#include "anigen/tracking/camera.h"
#include "anigen/tracking/distance_transform.h"
#include "anigen/tracking/frames.h"
#include "anigen/tracking/objective.h"
#include "anigen/tracking/rig_tensors.h"
#include "anigen/tracking/track.h"
#include "anigen/tracking/video_file.h"
