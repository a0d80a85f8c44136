#include "anigen/motions/built_in.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/text.h"
#include "anigen/motions/gaits.h"
#include "anigen/motions/gestures.h"

namespace anigen::motions {

namespace {

using Eigen::Vector3d;

bool has(const Body& body, LimbKind kind) { return !body.of_kind(kind).empty(); }

bool has_legs(const Body& body) {
  const std::size_t pairs = body.leg_pairs().size();
  return pairs >= 1 && pairs <= 5;
}

/// One way to make a motion.
struct Recipe {
  BuiltInMotion shown;
  std::function<bool(const Body&)> fits;
  std::function<void(Poser&, double)> pose;  ///< null for gaits
  double seconds = 1.0;
  bool loops = true;
};

const std::vector<Recipe>& recipes() {
  const auto any = [](const Body&) { return true; };
  const auto head = [](const Body& body) { return has(body, LimbKind::kHead); };
  const auto swims = [](const Body& body) {
    return !has_legs(body) && !has(body, LimbKind::kWing) && (!body.axis.empty() || has(body, LimbKind::kFin));
  };
  static const std::vector<Recipe> all = {
      {{"idle", "breathe, sway, keep the place", ""}, any, pose_idle, 3.0, true},
      {{"walk", "walk on two to ten legs", "two to ten legs in pairs"}, has_legs, nullptr, 1.0, true},
      {{"run", "run, trot or scuttle", "two to ten legs in pairs"}, has_legs, nullptr, 1.0, true},
      {{"jump", "crouch, leap, land; does not loop", "legs in pairs"}, has_legs, pose_jump, 1.5, false},
      {{"swim", "beat tail and fins", "a long body or fins, and no legs"}, swims, pose_swim, 1.1, true},
      {{"fly", "beat the wings", "wings"},
       [](const Body& body) { return has(body, LimbKind::kWing); },
       pose_fly,
       0.7,
       true},
      {{"slither", "wind like a snake", "a long thin body of five joints or more"},
       [](const Body& body) { return body.is_snake(); },
       pose_slither,
       1.6,
       true},
      {{"wave", "greet with an arm", "arms"},
       [](const Body& body) { return has(body, LimbKind::kArm); },
       pose_wave,
       2.6,
       true},
      {{"wag", "wag the tail", "a tail"},
       [](const Body& body) { return has(body, LimbKind::kTail); },
       pose_wag,
       0.6,
       true},
      {{"look", "look to both sides", "a head on the plane of symmetry"}, head, pose_look, 4.0, true},
      {{"nod", "nod twice", "a head on the plane of symmetry"}, head, pose_nod, 1.6, true},
      {{"dance", "bounce and sway on the spot", "legs in pairs"}, has_legs, pose_dance, 2.0, true},
      {{"spin", "turn about the vertical once", ""}, any, pose_spin, 2.0, true},
      {{"sway", "sway as a plant in the wind", "chains of two joints or more, or a back"},
       [](const Body& body) { return has(body, LimbKind::kChain) || has_legs(body); },
       pose_sway,
       3.0,
       true},
  };
  return all;
}

/// Way per second of motions that are no gaits.
Vector3d velocity_of(const Body& body, const std::string& word, double seconds) {
  const double size = body.figure.size;
  double speed = 0.0;
  if (word == "swim") speed = 0.8 * size;
  if (word == "fly") speed = 1.5 * size;
  if (word == "slither") speed = slither_stride(body) / seconds;
  return speed * body.figure.forward;
}

}  // namespace

void check_options(const MotionOptions& options) {
  if (options.frames != 0) require_between(options.frames, 2, 10000, "frames of a motion");
  const auto check = [](double value, double least, double most, const char* what) {
    if (!(value >= least && value <= most))
      throw InputError("", what, "must be from " + std::to_string(least) + " to " + std::to_string(most));
  };
  check(options.fps, 1.0, 240.0, "frames per second");
  check(options.speed, 0.01, 100.0, "speed");
}

const std::vector<BuiltInMotion>& built_in_motions() {
  static const std::vector<BuiltInMotion> all = [] {
    std::vector<BuiltInMotion> shown;
    for (const Recipe& recipe : recipes()) shown.push_back(recipe.shown);
    return shown;
  }();
  return all;
}

bool is_built_in(const std::string& word) {
  const auto& all = built_in_motions();
  return std::any_of(all.begin(), all.end(), [&](const BuiltInMotion& one) { return word == one.word; });
}

bool can_travel(const std::string& word) {
  return word == "walk" || word == "run" || word == "swim" || word == "fly" || word == "slither";
}

std::vector<std::string> motions_of(const Body& body) {
  std::vector<std::string> words;
  for (const Recipe& recipe : recipes()) {
    if (recipe.fits(body)) words.emplace_back(recipe.shown.word);
  }
  return words;
}

BodyMotion make_motion(const Body& body, const std::string& word, const MotionOptions& options) {
  check_options(options);
  const auto& all = recipes();
  const auto recipe = std::find_if(all.begin(), all.end(), [&](const Recipe& one) { return word == one.shown.word; });
  if (recipe == all.end()) {
    throw InputError("", "motion '" + word + "'",
                     "is none of " + joined(built_in_motions(), ", ", [](const auto& one) { return one.word; }));
  }
  if (!recipe->fits(body)) {
    throw InputError("", "motion '" + word + "'",
                     std::string("needs ") + recipe->shown.needs + "; this body has " + describe(body) +
                         " and can do: " + joined(motions_of(body)));
  }
  if (!recipe->pose) return gait_motion(body, word, options);
  BodyMotion motion;
  motion.name = word;
  motion.loops = recipe->loops;
  motion.times = key_times(recipe->seconds, options);
  const Vector3d velocity = options.speed * velocity_of(body, word, recipe->seconds);
  if (!options.travel) motion.ground_velocity = -velocity;
  const std::size_t count = motion.times.size();
  for (std::size_t f = 0; f < count; ++f) {
    double cycle = static_cast<double>(f) / static_cast<double>(count - 1);
    if (motion.loops && f + 1 == count) cycle = 0.0;
    Poser poser(body);
    recipe->pose(poser, cycle);
    motion.poses.push_back(poser.motions());
    if (options.travel) {
      for (metrics::RigidMotion& one : motion.poses.back()) one.shift += motion.times[f] * velocity;
    }
  }
  return motion;
}

BodyMotion t_pose(const Body& body) {
  Poser poser(body);
  std::size_t arms = 0;
  for (const int i : body.of_kind(LimbKind::kArm)) {
    const Limb& arm = body.limbs[at(i)];
    if (arm.side == 0 || arm.partner < 0) continue;
    ++arms;
    const Vector3d outward = arm.side * body.figure.left;
    const std::size_t upper = upper_arm(body, arm);
    Eigen::Quaterniond carried = Eigen::Quaterniond::Identity();
    for (std::size_t k = upper; k < arm.joints.size(); ++k) {
      const Vector3d& here = body.figure.tree.positions[at(arm.joints[k])];
      const bool is_last = k + 1 == arm.joints.size();
      if (is_last && k > upper + 1) break;  // fingers keep their pose
      const Vector3d next = is_last ? arm.tip : body.figure.tree.positions[at(arm.joints[k + 1])];
      const Eigen::Quaterniond wanted = Eigen::Quaterniond::FromTwoVectors(next - here, outward);
      poser.turn(arm.joints[k], carried.conjugate() * wanted);
      carried = wanted;
    }
  }
  if (arms == 0) throw InputError("", "pose 'T'", "needs two arms; this body has " + describe(body));
  BodyMotion motion;
  motion.name = "T-pose";
  motion.loops = false;
  motion.times = {0.0};
  motion.poses = {poser.motions()};
  return motion;
}

Animation idle_clip(const Asset& asset, const MotionOptions& options) {
  return to_clip(make_motion(analyse(asset), "idle", options), asset.skeleton);
}

}  // namespace anigen::motions
