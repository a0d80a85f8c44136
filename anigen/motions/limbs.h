#pragma once
#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "anigen/motions/figure.h"

namespace anigen::motions {

enum class LimbKind {
  kLeg,   ///< carries the body: its surface reaches the ground
  kArm,   ///< lateral, does not reach the ground
  kWing,  ///< lateral and flat, of a body that stands or hovers; fins of a manta count, too
  kFin,   ///< lateral, short, of a body that swims
  kHead,  ///< neck and head on the plane of symmetry
  kTail,  ///< behind the body, on the plane of symmetry
  kChain  ///< anything else of three joints or more: a tentacle, an antenna, a branch
};
const char* name_of(LimbKind kind);  ///< "leg", "arm", …

/// A part that hangs on the trunk.
struct Limb {
  LimbKind kind = LimbKind::kChain;
  std::vector<int> joints;  ///< from the trunk outwards, without side branches such as fingers
  int side = 0;             ///< 1 left, -1 right, 0 on the plane of symmetry
  int partner = -1;         ///< its mirrored limb
  int attached = -1;        ///< the joint of the trunk above joints.front(); -1: the limb begins at the root
  Eigen::Vector3d tip = Eigen::Vector3d::Zero();  ///< far end of its surface

  /// Of a leg, indices into joints: the leg bends at the knee between hip and ankle; the ankle's surface, with what is
  /// below it, stands on the ground. ankle == hip: a leg of one piece.
  std::size_t hip = 0, knee = 0, ankle = 0;
  Eigen::Vector3d contact = Eigen::Vector3d::Zero();  ///< of a leg: middle of the surface that touches the ground
};

/// Parts of a body.
struct Body {
  Figure figure;
  std::vector<int> trunk;   ///< from the pelvis, which carries the hind legs, to the chest; at least one joint
  int root = 0;             ///< deepest joint above everything that moves the surface
  std::vector<Limb> limbs;  ///< legs first, from front to back, the left one of a pair first
  std::vector<int> axis;    ///< from the tip of the head to that of the tail through the body, if it is long

  std::vector<int> of_kind(LimbKind kind) const;  ///< indices of limbs
  /// Left and right leg of each pair, from front to back.
  std::vector<std::array<int, 2>> leg_pairs() const;
  bool is_upright() const;    ///< stands on two legs with its trunk nearer to the vertical than to the horizontal
  bool is_snake() const;      ///< its axis lies on the ground
  double leg_length() const;  ///< of the shortest leg, from hip to ground; 0 without legs
};

/// Finds the parts of a body by its tree and its surface; names only help where they clearly say what a joint is. A
/// lamp or a plant has no legs, only chains.
Body analyse(Figure figure);
inline Body analyse(const Asset& asset) { return analyse(figure_of(asset)); }

/// "4 legs, tail, head" for reports; "no limbs" without any.
std::string describe(const Body& body);

}  // namespace anigen::motions
