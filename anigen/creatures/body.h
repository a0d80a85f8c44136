#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/random.h"
#include "anigen/creatures/shapes.h"

namespace anigen::creatures {

struct Surface;

/// A joint of a body plan and the bone that starts at it.
struct BodyJoint {
  std::string name;
  int parent = -1;
  Eigen::Vector3d position;
  Eigen::Vector3d tail;      ///< where its bone ends
  double radius = 0.0;       ///< of the limb around the joint: sets how wide the weights blend
  bool carries_skin = true;  ///< false: a ground root or an end joint, which real files have too
  int twist_of = -1;         ///< helper joint that takes over weight of this joint along its bone
  Eigen::Affine3d posed = Eigen::Affine3d::Identity();  ///< plan → posed space, set by apply_pose
};

/// One term of the idle animation: the joint swings about a world axis of the plan.
struct Swing {
  int joint;
  Eigen::Vector3d axis;
  double amplitude;  ///< radians
  double phase;      ///< radians
};

/// A creature before it has a surface: joints, the shapes hung on them, paints, a pose. Families fill it in the plan
/// frame (Z up, facing -Y, left is +X, any unit); apply_pose() then bends it into its bind pose.
class Body {
 public:
  explicit Body(Rng stream) : rng(stream) {}

  Rng rng;
  std::vector<BodyJoint> joints;
  std::vector<Primitive> primitives;
  std::vector<Paint> paints;
  std::vector<Swing> swings;

  double smoothness = 0.6;   ///< blend radius of a new primitive relative to its thinner end; 0: sharp unions
  double softness = 0.6;     ///< half width of weight bands relative to the limb radius
  int weight_smoothing = 3;  ///< diffusion steps over the mesh that follow
  double resolution = 1.0;   ///< relative vertex density
  bool machine = false;      ///< keep edges: no relaxation of vertices

  int add_paint(const Paint& paint);
  int joint(const std::string& name, int parent, const Eigen::Vector3d& position, const Eigen::Vector3d& tail,
            double radius);
  /// A joint without skin at the tail of another one.
  int end_joint(const std::string& name, int parent);
  /// A helper at fraction `at` of a bone which shares its skin.
  int twist_joint(const std::string& name, int of, double at);

  Primitive& cone(int joint, const Eigen::Vector3d& a, const Eigen::Vector3d& b, double ra, double rb, int paint);
  Primitive& ball(int joint, const Eigen::Vector3d& center, double radius, int paint);
  Primitive& ellipsoid(int joint, const Eigen::Vector3d& center, const Eigen::Vector3d& half, int paint,
                       const Eigen::Matrix3d& axes = Eigen::Matrix3d::Identity());
  Primitive& box(int joint, const Eigen::Vector3d& center, const Eigen::Vector3d& half, double rounding, int paint,
                 const Eigen::Matrix3d& axes = Eigen::Matrix3d::Identity());
  Primitive& cylinder(int joint, const Eigen::Vector3d& a, const Eigen::Vector3d& b, double ra, double rb,
                      double rounding, int paint);
  /// A thin triangle stretched between three joints (wing skin, fin, leaf); its skin is shared by `owners`.
  Primitive& sheet(const std::array<int, 3>& anchors, const std::array<Eigen::Vector3d, 3>& corners, double thickness,
                   int paint, const std::vector<int>& owners);
  void eye(int joint, const Eigen::Vector3d& center, double radius, const Eigen::Vector3d& look, int paint);

  /// A chain of joints at points[0 … n-1] with cones between consecutive points (n + 1 points and radii).
  std::vector<int> limb(int parent, const std::vector<std::string>& names, const std::vector<Eigen::Vector3d>& points,
                        const std::vector<double>& radii, int paint);

  void swing(int joint, const Eigen::Vector3d& axis, double amplitude, double phase = 0.0);
  /// Every joint of a chain, each later than the one before by `lag` radians.
  void swing_chain(const std::vector<int>& chain, const Eigen::Vector3d& axis, double amplitude, double lag);
  /// Makes the shapes of a joint blend less, or more, with what is around them.
  void scale_blends(int joint, double factor);
  /// Rotates a joint and everything below it in the bind pose, about an axis of the plan frame.
  void bend(int joint, const Eigen::Vector3d& axis, double angle);
  void bend_randomly(int joint, double angle);  ///< normal deviate of this many radians about a random axis

  /// Moves joints and primitives into the bind pose. Call once, last.
  void apply_pose();

  double between(double low, double high) { return rng.uniform(low, high); }
  int count(int low, int high) { return low + static_cast<int>(rng.index(static_cast<std::size_t>(high - low) + 1)); }

 private:
  Primitive& add(Primitive::Shape shape, int joint, double thickness, int paint);
  std::vector<Eigen::Quaterniond> bends_;
};

/// "left" for +1, "right" for -1.
std::string side_name(int side);
/// "name_01", "name_02", …
std::vector<std::string> numbered(const std::string& name, int count);
/// count + 1 points on a quadratic Bézier curve.
std::vector<Eigen::Vector3d> curve(const Eigen::Vector3d& from, const Eigen::Vector3d& control,
                                   const Eigen::Vector3d& to, int count);
/// count + 1 numbers from `from` to `to`, with the middle raised by the factor `bulge`.
std::vector<double> taper(double from, double to, int count, double bulge = 1.0);
/// A rotation whose third column is along z, and whose first is as close to x as that allows.
Eigen::Matrix3d frame_along(const Eigen::Vector3d& z, const Eigen::Vector3d& x = Eigen::Vector3d::UnitX());

/// The primitive that a vertex lies on.
const Primitive& nearest_primitive(const Body& body, const Surface& surface, std::size_t vertex);

/// Skin weights as an artist would paint them, for a posed body and its surface.
///
/// A vertex belongs to the joint of the primitive it lies on. Around every joint there is a band, across the bisector
/// of the two bones, in which weight passes from the parent to the child by a smooth step; its half width is
/// Body::softness times the limb radius. Bands act only along the tree: a vertex can hear its own joint, ancestors and
/// descendants up to three hops away, never another limb, however close that is in space. Joint::twist_of helpers take
/// over linearly along their bone. A few diffusion steps over the mesh, under the same restriction, even out what is
/// left; small weights are dropped.
/// @return one row per vertex, at most 8 influences each
SkinWeights paint_weights(const Body& body, const Surface& surface);

/// The embedded procedural dataset: rigged, skinned, coloured and animated creatures, plants and machines made from
/// random numbers. datasets/creatures.md is the recipe. Every asset is
///  - one closed two-manifold mesh (2 to 8 thousand vertices) with unit normals and linear vertex colours,
///  - a skeleton of 4 to 60 named joints, joint 0 the root (hips, pelvis or base), parents before children,
///  - ground-truth skin weights of at most 8 influences per vertex,
///  - one looping idle animation, one untextured material,
/// in the normalised frame: right-handed, Z up, facing -Y, its left side towards +X, bounding box centred in
/// [-0.5, 0.5]³ with longest side 1.
///
/// The result is a function of the arguments alone: no thread count, order of calls or earlier draw matters. One call
/// runs on the calling thread; parallelise over indices. Safe to call from several threads.

/// Names of all families, in a fixed order.
const std::vector<std::string>& creature_families();

/// The family that make_creature(seed, index) draws.
const std::string& creature_family(std::uint64_t seed, std::uint64_t index);

/// One creature; its family is drawn from the stream, uniformly.
Asset make_creature(std::uint64_t seed, std::uint64_t index);

/// One creature of a family.
/// @throws InputError when the family is unknown; the message lists the known ones
Asset make_creature(const std::string& family, std::uint64_t seed, std::uint64_t index);

}  // namespace anigen::creatures
