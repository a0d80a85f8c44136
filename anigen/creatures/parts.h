#pragma once
#include <string>
#include <vector>

#include "anigen/creatures/body.h"

namespace anigen::creatures {

/// Body parts that several families share. All positions are in the plan frame; `side` is +1 for left, -1 for right.

/// Two eyes on a head.
void add_eyes(Body& body, int joint, const Eigen::Vector3d& center, double apart, double radius,
              const Eigen::Vector3d& look);

/// A pair of horns, straight or curved back; rigid with the head.
void add_horns(Body& body, int joint, const Eigen::Vector3d& base, double apart, double length, double radius);

/// A pair of ears with a joint each.
void add_ears(Body& body, int head, const Eigen::Vector3d& base, double apart, const Eigen::Vector3d& direction,
              double length, int paint);

struct TailShape {
  Eigen::Vector3d from, direction;
  double length, radius, tip;
  int segments;
  double droop;  ///< how far the tip hangs below the straight line, relative to the length
};
std::vector<int> add_tail(Body& body, int parent, const TailShape& shape, int paint);

/// A hand at the end of a forearm that points along `out`; fingers lie in the plane of `out` and `across`.
/// @return the hand's joint
int add_hand(Body& body, int parent, const std::string& prefix, const Eigen::Vector3d& wrist,
             const Eigen::Vector3d& out, const Eigen::Vector3d& across, double size, int fingers, int segments,
             int paint);

/// A leg of jointed segments; the last point is where it ends.
std::vector<int> add_leg(Body& body, int parent, const std::string& prefix, const std::vector<std::string>& names,
                         const std::vector<Eigen::Vector3d>& points, const std::vector<double>& radii, int paint);

/// Habits of real files, each with some probability: a ground root is the family's own business (it must be joint 0);
/// this adds end joints to chains and twist helpers to the given limbs while fewer than `most` joints exist.
void add_rig_habits(Body& body, const std::vector<int>& limbs, const std::vector<int>& tips, int most = 60);

/// Sometimes a root at the ground without skin, as engines want it; -1 when there is none.
int maybe_ground_root(Body& body, double probability);

struct WingShape {
  Eigen::Vector3d shoulder;
  double span, chord, radius, thickness;
  double sweep;  ///< how far the tip lies behind the shoulder, relative to the span

  /// A place beside the shoulder, relative to the span.
  Eigen::Vector3d at(int side, double out, double back, double up) const {
    return shoulder + Eigen::Vector3d(side * out * span, back * span, up * span);
  }
};

/// A feathered wing: three joints, a stiff vane behind each bone. @return its joints
std::vector<int> add_feathered_wing(Body& body, int parent, int side, const WingShape& shape, int bone, int feathers);

/// A bat's or dragon's wing: arm, forearm and fingers with skin stretched between them. @return its joints
std::vector<int> add_skin_wing(Body& body, int parent, int side, const WingShape& shape, int fingers, int bone,
                               int skin);

/// The families: each fills an empty body with the joints, shapes, paints, swings and bends of one random member.
void build_biped(Body& body);
void build_quadruped(Body& body);
void build_bird(Body& body);
void build_fish(Body& body);
void build_snake(Body& body);
void build_spider(Body& body);
void build_insect(Body& body);
void build_dragon(Body& body);
void build_plant(Body& body);
void build_tree(Body& body);
void build_robot_arm(Body& body);
void build_lamp(Body& body);
void build_crab(Body& body);
void build_octopus(Body& body);
void build_hand(Body& body);

}  // namespace anigen::creatures
