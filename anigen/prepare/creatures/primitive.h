#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <vector>

namespace anigen::prepare {

/// A solid with a signed distance (negative inside), attached to a joint.
struct Primitive {
  enum class Shape {
    kCone,       ///< spheres of radius ra at a to rb at b, and everything between: a tapered capsule
    kEllipsoid,  ///< centre a, half axes `half` along the columns of `axes`
    kBox,        ///< centre a, half sides `half` along `axes`, edges rounded by ra
    kCylinder,   ///< frustum from a (radius ra) to b (radius rb) with flat caps, edges rounded by half.x
    kSheet,      ///< triangle a, b, c thickened by ra on both sides
  };
  Shape shape = Shape::kCone;
  Eigen::Vector3d a = Eigen::Vector3d::Zero(), b = Eigen::Vector3d::Zero(), c = Eigen::Vector3d::Zero();
  double ra = 0.0, rb = 0.0;
  Eigen::Vector3d half = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  double blend = 0.0;            ///< radius of the smooth union with what was there before
  bool carve = false;            ///< subtract instead of unite
  int joint = 0;                 ///< carries it and owns its skin
  std::array<int, 3> anchors{};  ///< joints that carry a, b and c
  std::vector<int> owners;       ///< joints that share its skin; empty: `joint` alone
  int paint = 0;
  Eigen::Vector3d unit = Eigen::Vector3d::UnitZ();  ///< set by settle(): direction from a to b, or a sheet's normal
  double length = 0.0, lean = 0.0;                  ///< set by settle()
  Eigen::Vector3d center = Eigen::Vector3d::Zero(), look = Eigen::Vector3d::Zero();  ///< of an eye, in the plan frame
};

/// Computes what the distance functions need from the geometry. Call after every change of it.
void settle(Primitive& primitive);

/// Signed distance of a settled primitive; exact except for ellipsoids, where it is a first-order estimate that is
/// exact on the surface.
double signed_distance(const Primitive& primitive, const Eigen::Vector3d& x);

/// A lower bound of the distance from x to the primitive, tight far away; used to skip empty space.
double distance_bound(const Primitive& primitive, const Eigen::Vector3d& x);

/// Approximate surface area.
double surface_area(const Primitive& primitive);

/// Largest and smallest coordinates.
void bounds(const Primitive& primitive, Eigen::Vector3d& low, Eigen::Vector3d& high);

/// Thickens what a grid of the given spacing would lose, and settles.
void ensure_thickness(Primitive& primitive, double spacing);

}  // namespace anigen::prepare
