#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <vector>

#include "anigen/core/random.h"

namespace anigen::creatures {

/// Paint of a part of a creature. Colours are linear RGB.
struct Paint {
  enum class Pattern { kPlain, kStripes, kBands, kSpots, kMottled, kEye, kPanels };
  Pattern pattern = Pattern::kPlain;
  Eigen::Vector3d base = Eigen::Vector3d::Constant(0.5);
  Eigen::Vector3d under = Eigen::Vector3d::Constant(0.5);  ///< colour of surfaces that face `down`
  Eigen::Vector3d accent = Eigen::Vector3d::Zero();        ///< of stripes, spots; the pupil of an eye
  Eigen::Vector3d down = -Eigen::Vector3d::UnitZ();        ///< belly direction in the plan frame; zero: no gradient
  Eigen::Vector3d along = Eigen::Vector3d::UnitY();        ///< across the stripes
  double frequency = 8.0;                                  ///< stripes or spots per unit length of the plan
  double strength = 0.8;                                   ///< 0: no pattern
  double phase = 0.0;
};

/// Colour at a point of the plan frame with the given normal there.
/// @param center, look of the eye the point belongs to, for kEye only
Eigen::Vector3d paint_color(const Paint& paint, const Eigen::Vector3d& x, const Eigen::Vector3d& normal,
                            const Eigen::Vector3d& center, const Eigen::Vector3d& look);

/// Linear RGB of hue (in turns), saturation and value (of the sRGB colour), all in [0, 1].
Eigen::Vector3d color_of(double hue, double saturation, double value);

/// An animal's coat: base, belly and pattern that go together.
/// @param size length of the body, to which the pattern is scaled
Paint random_coat(Rng& rng, double size, const Eigen::Vector3d& along);
Paint plain(const Eigen::Vector3d& color);
/// A shade of another paint without its pattern.
Paint shade(const Paint& paint, double factor);
Paint eye_paint(Rng& rng);
/// Painted, bare or anodised metal, or plastic.
Paint machine_paint(Rng& rng, bool bright);

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

/// 0 up to `low`, 1 from `high` on, 3t² − 2t³ between.
double smoothstep(double low, double high, double x);

/// Distance from a point to a segment, in two or three dimensions.
template <typename Point>
double segment_distance(const Point& p, const Point& a, const Point& b) {
  const Point ab = b - a;
  const double t = std::clamp((p - a).dot(ab) / std::max(ab.squaredNorm(), 1e-24), 0.0, 1.0);
  return (p - a - t * ab).norm();
}

}  // namespace anigen::creatures
