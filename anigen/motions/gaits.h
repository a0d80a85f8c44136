#pragma once
#include <vector>

#include "anigen/motions/built_in.h"

namespace anigen::motions {

/// A way to walk.
struct Gait {
  double seconds = 1.0;       ///< of a cycle
  double duty = 0.6;          ///< share of the cycle that each foot stands
  double stride = 1.0;        ///< way of the body in a cycle, the file's unit
  double lift = 0.1;          ///< of a foot, the file's unit
  double drop = 0.0;          ///< of the hips, so that feet reach
  double bob = 0.0;           ///< of the body, up and down
  std::vector<double> phase;  ///< per leg pair and side: when in the cycle the foot comes down, in [0, 1)
  bool runs = false;
};

/// A gait for a body with two to ten legs in pairs: two legs alternate; four walk in lateral sequence and trot; six
/// go in alternating tripods; more in waves from the hind legs to the front, sides alternating. Strides are shortened
/// until every foot reaches. @pre body.leg_pairs() is not empty
Gait gait_of(const Body& body, bool runs);

/// Places all feet for a time of the cycle; the rest of the pose has to be there already.
/// @param cycle in [0, 1) @param along way of the body since the beginning, where it travels; else 0
void place_feet(Poser& poser, const Gait& gait, double cycle);

/// True while a foot stands. @param leg index of the pair times two, plus one for the right side
bool stands(const Gait& gait, std::size_t leg, double cycle);

/// All feet where they stand in the bind pose, level, in pairs.
void plant_feet(Poser& poser);

/// Place of a leg's ankle while its foot stands below the hip: as in the bind pose, but level with its partner and on
/// the ground.
Eigen::Vector3d neutral_ankle(const Body& body, const Limb& leg);

/// Index into an arm's joints of the upper arm, behind collar bones.
std::size_t upper_arm(const Body& body, const Limb& arm);

/// Turns joints of a line, each by its share, so that they sum up to `degrees`.
void turn_line(Poser& poser, const std::vector<int>& joints, const Eigen::Vector3d& axis, double degrees);

/// Sways all tails, a wave running outwards. @param degrees of the end
void sway_tails(Poser& poser, double cycle, double degrees);

/// The turn that lowers a bound arm, identity for one that hangs.
Eigen::Quaterniond lowering_turn(const Body& body, const Limb& arm);

/// Bends the elbow of an arm that lower_arms() has lowered, so that the hand goes forward.
void bend_elbow(Poser& poser, const Limb& arm, double degrees);

/// Lowers the arms of an upright body that is bound with arms aside, and bends its elbows a little.
void lower_arms(Poser& poser);

/// walk or run.
BodyMotion gait_motion(const Body& body, const std::string& word, const MotionOptions& options);

/// Key times of a clip. @param seconds at speed 1 @return at least 2, from 0
std::vector<double> key_times(double seconds, const MotionOptions& options);

}  // namespace anigen::motions
