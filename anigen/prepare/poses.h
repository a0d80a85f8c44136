#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/asset/skeleton.h"
#include "anigen/core/random.h"
#include "anigen/geometry/sampling.h"
#include "anigen/prepare/sources.h"

namespace anigen::prepare {

/// Effect of a pose on a mesh; "before" is the source's bind pose. Files exist whose animations play the whole object
/// at a hundredth of its bind pose's size. Since posed meshes are normalised again, that is not collapse: everything
/// after `scale` is measured after division by it.
struct PoseMeasures {
  bool finite = true;                  ///< every vertex, and within 1,000 times the source's size
  double scale = 1.0;                  ///< root of the faces' median change of area, each weighted by its area before
  double change = 0.0;                 ///< RMS way of the vertices beyond their mean, over the source's longest side
  double box_ratio = 1.0;              ///< longest side of the bounding box, after / before
  double thickness_ratio = 1.0;        ///< middle side / longest side of the bounding box, after / before
  double area_ratio = 1.0;             ///< surface, after / before
  std::optional<double> volume_ratio;  ///< enclosed volume, after / before; only for a closed, oriented surface
  double shrunk_share = 0.0;           ///< of the surface before: triangles with less than 5 % of their area left
  double stretched_share = 0.0;        ///< of the surface after: triangles with an edge more than 4 times as long
  double buried_share = 0.0;           ///< of the surface: hidden from every direction after, less hidden before
};

/// Limits that a pose must keep. They reject collapse, not style. Set on 59 assets (44 real rigs, 15 creatures) with 6
/// random poses each: but for lumberjack and the tree, which tear in most poses, areas lay within 0.87 … 1.25; volumes
/// lay within 0.80 … 1.07 and shrunk shares below 0.004 everywhere; 92 % kept the stretched share below 0.10, and 97 %
/// the buried share below 0.12. docs/images/augmentation.png shows what passes.
struct PoseLimits {
  using Range = std::array<double, 2>;  ///< least and most

  double least_scale = 1e-3;
  double least_change = 0.005;
  Range box{0.3, 3.0};
  double least_thickness = 0.25;
  Range area{0.75, 1.3}, volume{0.75, 1.3};
  double most_shrunk = 0.02;
  double most_stretched = 0.10;
  double most_buried = 0.12;

  /// @throws InputError naming the limit that is negative or not a number
  void validate() const;
};
ANIGEN_JSON_RECORD(PoseLimits, least_scale, least_change, box, least_thickness, area, volume, most_shrunk,
                   most_stretched, most_buried)

Json to_json(const PoseMeasures& measures);

/// The first limit that is broken, with its figures ("surface area 0.41 of the source's, at least 0.6"); empty when
/// none is.
std::string broken_limit(const PoseMeasures& measures, const PoseLimits& limits);

/// Measures poses of one mesh: set up once, ask from any thread.
///
/// `buried_share` looks from 400 places, spread over the source's surface and carried along by their triangles, in 32
/// directions over the whole sphere: a place is buried when no ray leaves the mesh. A closed mesh sees half of its
/// rays end inside itself and the rest leave, so this needs neither closed nor consistently oriented surfaces; parts
/// pushed into other parts are counted, and so are folds shut tight. What was hidden before (the inside of a
/// mouth) does not count.
class PoseChecks {
 public:
  /// @throws InputError for a mesh without faces, with a bad index or a vertex that is not finite
  explicit PoseChecks(const Mesh& source);

  /// @param vertices of the source, moved, [V]; need not be finite @throws InputError when their number differs
  PoseMeasures measure(const std::vector<Eigen::Vector3f>& vertices) const;

 private:
  std::vector<bool> hidden_places(const std::vector<Eigen::Vector3f>& posed, double size) const;

  std::vector<Eigen::Vector3f> vertices_;
  std::vector<Triangle> faces_;
  Box box_;
  std::vector<double> areas_;
  double total_area_ = 0.0;
  std::optional<double> volume_;
  std::vector<geometry::SurfacePoint> places_;
  std::vector<bool> hidden_;  ///< [places], before
};

enum class PoseKind { kAnimation, kRandom };
std::string to_string(PoseKind kind);  ///< "animation", "random"

/// Origin of a posed variant, or the reason why there is none.
struct Provenance {
  std::string source_id;
  std::uint64_t seed = 0;
  std::size_t k = 0;
  PoseKind kind = PoseKind::kRandom;
  std::string clip;            ///< name of the animation, for kAnimation; files leave it empty at times
  double time = 0.0;           ///< seconds into the clip
  double second_time = 0.0;    ///< seconds; the other end of a blend, `time` where there is none
  double blend = 0.0;          ///< 0: the pose at `time`; up to ½ towards the pose at `second_time`
  int attempt = 0;             ///< draws rejected before this one
  std::size_t turned = 0;      ///< joints whose orientation relative to the parent differs from the source's bind pose
  double largest_angle = 0.0;  ///< degrees, of those joints
  Eigen::Vector3d axis_factors = Eigen::Vector3d::Ones();  ///< of the posed asset, see PoseAugmentation
  Similarity renormalization;                              ///< variant = scale · (posed, its axes scaled) + offset
  PoseMeasures measures;                                   ///< of the pose that was taken, or of the last one rejected
  std::vector<std::string> rejections;                     ///< why the draws before failed, in order
  std::vector<std::string> unused_clips;                   ///< "<name>: <reason>"
};

/// All of it, with measures rounded to six digits.
Json to_json(const Provenance& provenance);

/// Rotations of joints about their own positions, [J]: the R_k of docs/reference/training.md, 6. They are written in
/// axes parallel to the world's in the bind pose, and act on everything below the joint.
struct JointTurns {
  std::vector<Eigen::Matrix3d> rotations;
  std::vector<double> angles;  ///< radians; 0 for a joint that was left alone
};

/// R_k of each joint: with `probability` (the paper: 80 %) about an axis uniform on the sphere by an angle uniform in
/// [0, max_angle] (60°), else the identity.
/// @param max_angle radians @param include_root false leaves joint 0 alone
JointTurns draw_turns(std::size_t joints, double probability, double max_angle, bool include_root, Rng& rng);

/// Joint → world after the turns, [J], from the bind pose:
///   G_root = R_root, g_root = J_root; G_k = G_p R_k, g_k = g_p + G_p (J_k − J_p); world_k = [G_k | g_k − G_k J_k]
///   bind_k
/// so that skinning with world_k · bind_k⁻¹ gives the reference's Σ_k w (G_k v + g_k − G_k J_k), and scale or shear of
/// a joint's frame stays as it is.
std::vector<Eigen::Matrix4d> turned_joints(const Skeleton& skeleton, const JointTurns& turns);

}  // namespace anigen::prepare
