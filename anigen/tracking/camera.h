#pragma once
#include <Eigen/Core>

#include "anigen/nn/torch.h"
#include "anigen/render/cameras_json.h"
#include "anigen/tracking/frames.h"
#include "anigen/tracking/rig_tensors.h"

namespace anigen::tracking {

/// A pinhole camera of square pictures: OpenCV axes, normalised intrinsics.
struct PinholeCamera {
  Eigen::Matrix4d world_to_camera = Eigen::Matrix4d::Identity();
  double focal_x = 1.0, focal_y = 1.0, center_x = 0.5, center_y = 0.5;
};

/// The camera of a view as our renderer writes it. @throws InputError when its matrix has no inverse
PinholeCamera pinhole(const render::Frame& frame);

/// Clip positions for raster::rasterize(): row 0 is the top. Unlike the published projection right for any centre.
/// @param vertices [V, 3] world, fp64 @return [V, 4]
/// @throws InputError for a camera with a number that is not finite, or without focal length
Tensor clip_positions(const Tensor& vertices, const PinholeCamera& camera);

/// Picture places (u, v) in [0, 1]² of clip positions. @return [V, 2]
Tensor picture_places(const Tensor& clip);

/// A camera and how well it shows the rig in its bind pose.
struct FittedCamera {
  PinholeCamera camera;
  double yaw_degrees = 0.0;    ///< 0: from the front of an asset that faces −Y
  double pitch_degrees = 0.0;  ///< from above
  double overlap = 0.0;        ///< intersection over union of both silhouettes
};

/// A camera for frames that come without one: field of view 40°, no roll, at the yaw (within 90° of the front) and
/// pitch (0° … 20°), scale and place in the picture under which the bind pose covers the frame's silhouette best, its
/// colours deciding between sides that look alike. A search over yaw and pitch, each with the boxes of both silhouettes
/// laid upon each other; then, from the best on, Nelder and Mead's simplex (1965) over all five numbers.
FittedCamera fit_camera(const RigTensors& rig, const FrameLevel& frame);

}  // namespace anigen::tracking
