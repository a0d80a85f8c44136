#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::creatures {

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

/// Indices of the primitives that can matter in a region, ascending.
using PrimitiveList = std::vector<int>;

/// The implicit solid that primitives form: each is united with what came before it by a quadratic smooth minimum of
/// radius `blend` (a plain minimum where that is 0), or carved out of it. Negative inside.
class Field {
 public:
  explicit Field(std::vector<Primitive> primitives);

  const std::vector<Primitive>& primitives() const { return primitives_; }
  double value(const Eigen::Vector3d& x, const PrimitiveList& list) const;
  /// Finite differences over four points `step` away.
  Eigen::Vector3d gradient(const Eigen::Vector3d& x, const PrimitiveList& list, double step) const;
  /// Those of `list` that shape the field within `reach` of x: a few, where the list of a block has a dozen.
  void narrow(const Eigen::Vector3d& x, const PrimitiveList& list, double reach, PrimitiveList& result) const;

  enum class Content { kOutside, kInside, kMixed };
  /// Content of a ball; for kMixed `list` receives those of `candidates` that shape the field there.
  /// @param candidates all primitives, or the list of a larger ball around this one
  Content classify(const Eigen::Vector3d& center, double radius, const PrimitiveList& candidates,
                   PrimitiveList& list) const;

 private:
  std::vector<Primitive> primitives_;
};

/// The boundary of a Field as a closed, connected, orientable two-manifold.
struct Surface {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<Eigen::Vector3d> normals;  ///< outward, unit length
  std::vector<Triangle> faces;           ///< counter-clockwise seen from outside
  std::vector<int> vertex_lists;         ///< per vertex, index into lists
  std::vector<PrimitiveList> lists;      ///< primitives near a block of the grid
};

/// Surface nets (Gibson 1998) on the blocks of a regular grid that the surface passes through: one vertex per cell
/// whose corners differ in sign, one quad per grid edge that does. Cells whose corners would make the result
/// non-manifold (two inside corners that only touch across a face or through the cell) are repaired first by turning
/// corners into inside ones, which makes the sampled solid well-composed; small separate pieces and closed cavities
/// are dropped. Vertices are then pulled onto the field by Newton steps inside their cell.
/// @param spacing     grid spacing; primitives thinner than a cell are thickened
/// @param relaxations tangential smoothing steps before the last projection; 0 keeps edges where the grid put them
/// @return no vertices at all when this spacing cannot be repaired locally: try another one
///
/// Edges and seams are rounded by about a spacing, since a mesh without sharp features would show them ragged.
Surface extract_surface(const std::vector<Primitive>& primitives, double spacing, int relaxations);

/// Estimated number of vertices of extract_surface(), from a coarse grid; within some ten percent.
double estimate_vertices(const std::vector<Primitive>& primitives, double spacing);

}  // namespace anigen::creatures
