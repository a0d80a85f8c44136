#pragma once
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::raytrace {

/// A pinhole camera in the world frame (Z up). Pixel (0, 0) is the top left; x runs right, y down; the centre of
/// pixel (i, j) is (i + 0.5, j + 0.5).
struct Camera {
  Eigen::Vector3d eye = Eigen::Vector3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::UnitX();
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d forward = Eigen::Vector3d::UnitY();  ///< right × up points back at the viewer
  double tangent = 0.5;                                ///< of half the vertical field of view
  int width = 1, height = 1;

  /// Direction of the ray through a point of the picture, of such a length that its part along `forward` is 1: what it
  /// meets at distance t has depth t.
  Eigen::Vector3d ray(double x, double y) const;
  /// The same with unit length.
  Eigen::Vector3d direction(double x, double y) const;
  /// Picture x, y and the depth along `forward`; x and y mean nothing where depth ≤ 0.
  Eigen::Vector3d project(const Eigen::Vector3d& point) const;
};

/// A view on a circle around an object. Yaw 0 looks at the front of a glTF asset (from −Y); positive yaw moves the
/// camera counter-clockwise seen from above, positive pitch up.
struct Orbit {
  double yaw_degrees = 30.0;
  double pitch_degrees = 15.0;  ///< in [-90, 90]
  double fov_degrees = 30.0;    ///< vertical, in [1, 150]
  double margin = 1.1;          ///< > 1 leaves a border around the object
  /// What to look at and fit. Without it, all vertices, as large and as central in the picture as they go. Give the
  /// box of a whole animation to keep the camera still: the eye then turns around the centre of that box.
  std::optional<Box> fit;
  std::optional<double> distance;  ///< from the centre of the box to the eye, which then looks at that centre
};

/// @param points what must be visible unless orbit.fit says otherwise; empty: a unit cube around the origin
/// @throws InputError naming the option that is out of range
Camera orbit_camera(const Orbit& orbit, const std::vector<Eigen::Vector3f>& points, int width, int height);

/// The smallest distance from the centre of the box at which everything is visible while the eye looks at that centre:
/// what turntables need, where a camera that follows the outline would make the object sway.
double centred_distance(const Orbit& orbit, const std::vector<Eigen::Vector3f>& points, int width, int height);

}  // namespace anigen::raytrace
