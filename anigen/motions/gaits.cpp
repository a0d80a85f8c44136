#include "anigen/motions/gaits.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/core/numeric.h"

namespace anigen::motions {

namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

const Vector3d kUp = Vector3d::UnitZ();

double fraction(double x) { return x - std::floor(x); }

double smooth(double x) { return x * x * (3.0 - 2.0 * x); }

const Vector3d& bind_place(const Body& body, int joint) { return body.figure.tree.positions[at(joint)]; }

double reach_aside(const Body& body, const Limb& leg) {
  const Vector3d way = leg.contact - bind_place(body, leg.joints[leg.hip]);
  return std::hypot(way.x(), way.y());
}

/// Legs in the order of Gait::phase.
std::vector<const Limb*> legs_of(const Body& body) {
  std::vector<const Limb*> legs;
  for (const auto& pair : body.leg_pairs()) {
    legs.push_back(&body.limbs[at(pair[0])]);
    legs.push_back(&body.limbs[at(pair[1])]);
  }
  return legs;
}

std::vector<double> phases(std::size_t pairs, bool runs) {
  std::vector<double> result;
  for (std::size_t pair = 0; pair < pairs; ++pair) {  // from front to back
    double left = 0.0;
    if (pairs == 2) {
      left = runs ? (pair == 0 ? 0.5 : 0.0) : (pair == 0 ? 0.25 : 0.0);  // trot; lateral sequence
    } else if (pairs == 3) {
      left = pair == 1 ? 0.5 : 0.0;
    } else if (pairs > 3) {
      left = fraction(0.5 * static_cast<double>(pair % 2) + 0.12 * static_cast<double>(pairs - 1 - pair));
    }
    // A foot comes down at its phase: half a cycle lies between left and right.
    result.push_back(fraction(1.0 - left));
    result.push_back(fraction(1.5 - left));
  }
  return result;
}

/// Place of a foot relative to where it stands below the hip, and its pitch in degrees, toes down positive.
struct Step {
  double along = 0.0, up = 0.0, pitch = 0.0;
};

Step step_of(const Gait& gait, std::size_t leg, double cycle) {
  const double u = fraction(cycle + gait.phase[leg]);
  const double half = 0.5 * gait.stride * gait.duty;
  if (u < gait.duty) return {half * (1.0 - 2.0 * u / gait.duty), 0.0, 0.0};
  const double s = (u - gait.duty) / (1.0 - gait.duty);
  Step step;
  step.along = half * (2.0 * smooth(s) - 1.0);
  step.up = gait.lift * std::pow(std::sin(kPi * s), 2.0) * (1.25 - 0.5 * s);
  step.pitch =
      (gait.runs ? 45.0 : 28.0) * std::pow(std::sin(kPi * std::min(1.0, 1.6 * s)), 2.0) * (s < 0.625 ? 1.0 : 0.0) -
      (s > 0.6 ? 10.0 * std::pow(std::sin(kPi * (s - 0.6) / 0.4), 2.0) : 0.0);
  return step;
}

/// Length of a foot's surface before and behind its ankle.
struct FootLength {
  double toes = 0.0, heel = 0.0;
};

FootLength foot_length(const Body& body, const Limb& leg) {
  FootLength length;
  const Vector3d& ankle = bind_place(body, leg.joints[leg.ankle]);
  for (const int j : body.figure.subtree(leg.joints[leg.ankle])) {
    for (const Vector3d& p : body.figure.surface[at(j)]) {
      if (p.z() > ankle.z()) continue;
      length.toes = std::max(length.toes, body.figure.forward.dot(p - ankle));
      length.heel = std::max(length.heel, -body.figure.forward.dot(p - ankle));
    }
  }
  return length;
}

bool reaches(const Body& body, const Gait& gait) {
  const std::vector<const Limb*> legs = legs_of(body);
  for (std::size_t i = 0; i < legs.size(); ++i) {
    const Limb& leg = *legs[i];
    if (leg.ankle <= leg.hip + 1) continue;  // of one piece
    const Vector3d hip = bind_place(body, leg.joints[leg.hip]) - (gait.drop - 0.5 * gait.bob) * kUp;
    const Vector3d neutral = neutral_ankle(body, leg);
    const double most = (gait.runs ? 0.985 : 0.995) * reach_of(body, leg);
    for (const double end : {-1.0, 1.0}) {
      const Vector3d ankle = neutral + end * 0.5 * gait.stride * gait.duty * body.figure.forward;
      if ((ankle - hip).norm() > most) return false;
    }
  }
  return true;
}

void swing_arms(Poser& poser, double cycle, double degrees, double elbow) {
  const Body& body = poser.body();
  for (const int i : body.of_kind(LimbKind::kArm)) {
    const Limb& arm = body.limbs[at(i)];
    if (arm.side == 0) continue;
    const double swing = degrees * std::cos(2.0 * kPi * cycle) * arm.side;
    const std::size_t upper = upper_arm(body, arm);
    poser.turn(arm.joints[upper], body.figure.left, swing);
    bend_elbow(poser, arm, elbow + 0.3 * std::max(0.0, -swing));
  }
}

void pose_trunk(Poser& poser, const Gait& gait, double cycle, double leg_length) {
  const Body& body = poser.body();
  const Figure& figure = body.figure;
  const std::size_t pairs = body.leg_pairs().size();
  const double turn = 2.0 * kPi * cycle;
  // Lowest when a foot comes down, twice in a cycle.
  poser.shift(-gait.drop * kUp - gait.bob * std::cos(2.0 * turn) * kUp);
  if (pairs == 1) {
    const double strength = gait.runs ? 1.4 : 1.0;
    poser.shift((gait.runs ? 0.01 : 0.025) * leg_length * std::sin(turn) * figure.left);
    const double yaw = -5.0 * strength * std::cos(turn);
    poser.turn(body.root, kUp, yaw);
    poser.turn(body.root, figure.forward, -2.0 * strength * std::sin(turn));
    if (body.is_upright()) {
      if (gait.runs) poser.turn(body.root, figure.left, 9.0);
      std::vector<int> back(body.trunk.begin() + 1, body.trunk.end());
      turn_line(poser, back, kUp, -2.2 * yaw);
    }
  } else {
    const double strength = pairs == 2 ? 1.0 : 0.4;
    poser.turn(body.root, figure.forward, 1.5 * strength * std::sin(turn));
    poser.turn(body.root, figure.left, (gait.runs ? 1.5 : 0.7) * strength * std::sin(2.0 * turn));
    std::vector<int> back(body.trunk.begin() + 1, body.trunk.end());
    turn_line(poser, back, kUp, 4.0 * strength * std::sin(turn));
  }
  for (const int i : body.of_kind(LimbKind::kHead)) {
    const Limb& head = body.limbs[at(i)];
    turn_line(poser, head.joints, figure.left, (pairs == 1 ? 1.0 : 3.5) * std::sin(2.0 * turn));
  }
}

}  // namespace

void turn_line(Poser& poser, const std::vector<int>& joints, const Vector3d& axis, double degrees) {
  for (const int j : joints) poser.turn(j, axis, degrees / static_cast<double>(joints.size()));
}

void sway_tails(Poser& poser, double cycle, double degrees) {
  const Body& body = poser.body();
  for (const int i : body.of_kind(LimbKind::kTail)) {
    const std::vector<int>& joints = body.limbs[at(i)].joints;
    for (std::size_t k = 0; k < joints.size(); ++k) {
      const double lag = 0.12 * static_cast<double>(k);
      poser.turn(joints[k], kUp, degrees / static_cast<double>(joints.size()) * std::sin(2.0 * kPi * (cycle - lag)));
    }
  }
}

std::vector<double> key_times(double seconds, const MotionOptions& options) {
  const double length = seconds / options.speed;
  const int frames =
      options.frames > 0 ? options.frames : std::max(2, static_cast<int>(std::lround(length * options.fps)) + 1);
  std::vector<double> times;
  for (int f = 0; f < frames; ++f) times.push_back(frames == 1 ? 0.0 : length * f / (frames - 1));
  return times;
}

Vector3d neutral_ankle(const Body& body, const Limb& leg) {
  const Figure& figure = body.figure;
  const int end = leg.joints[leg.ankle];
  Vector3d ankle = leg.ankle == leg.hip ? leg.contact : bind_place(body, end);
  double ground = leg.contact.z();
  for (const int i : body.of_kind(LimbKind::kLeg)) ground = std::min(ground, body.limbs[at(i)].contact.z());
  ankle.z() += ground - leg.contact.z();
  if (leg.partner >= 0) {  // a body bound in the middle of a step
    const Limb& other = body.limbs[at(leg.partner)];
    const double apart = figure.forward.dot(other.contact - leg.contact);
    ankle += 0.5 * apart * figure.forward;
  }
  return ankle;
}

bool stands(const Gait& gait, std::size_t leg, double cycle) { return fraction(cycle + gait.phase[leg]) < gait.duty; }

Gait gait_of(const Body& body, bool runs) {
  const std::size_t pairs = body.leg_pairs().size();
  double length = std::numeric_limits<double>::infinity(), aside = 0.0;
  bool of_one_piece = false;
  for (const Limb* leg : legs_of(body)) {
    length = std::min(length, bind_place(body, leg->joints[leg->hip]).z() - leg->contact.z());
    aside = std::max(aside, reach_aside(body, *leg));
    of_one_piece = of_one_piece || leg->ankle <= leg->hip + 1;
  }
  length = std::max(length, 0.02 * body.figure.height);
  Gait gait;
  gait.runs = runs;
  gait.phase = phases(pairs, runs);
  if (pairs == 1) {
    gait.seconds = runs ? 0.66 : 1.05;
    gait.duty = runs ? 0.36 : 0.62;
    gait.stride = (runs ? 2.2 : 1.25) * length;
    gait.lift = (runs ? 0.28 : 0.14) * length;
    gait.bob = (runs ? 0.04 : 0.02) * length;
  } else if (pairs == 2) {
    gait.seconds = runs ? 0.6 : 1.1;
    gait.duty = runs ? 0.45 : 0.66;
    gait.stride = (runs ? 1.7 : 1.0) * length;
    gait.lift = (runs ? 0.25 : 0.16) * length;
    gait.bob = (runs ? 0.03 : 0.012) * length;
  } else {
    const double base = std::max(0.8 * length, 0.35 * aside);
    gait.seconds = (runs ? 0.4 : 0.7) + 0.05 * static_cast<double>(pairs - 3);
    gait.duty = (pairs == 3 ? 0.55 : 0.65) - (runs ? 0.05 : 0.0);
    gait.stride = (runs ? 1.3 : 1.0) * base;
    gait.lift = 0.25 * base;
    gait.bob = 0.01 * length;
  }
  if (of_one_piece) gait.stride *= 0.55, gait.lift *= 0.5;
  for (int attempt = 0; attempt < 60 && !reaches(body, gait); ++attempt) {
    if (gait.drop < (runs ? 0.12 : 0.07) * length) {
      gait.drop += 0.01 * length;
    } else {
      gait.stride *= 0.94;
    }
  }
  return gait;
}

void place_feet(Poser& poser, const Gait& gait, double cycle) {
  const Body& body = poser.body();
  const std::vector<const Limb*> legs = legs_of(body);
  for (std::size_t i = 0; i < legs.size(); ++i) {
    const Limb& leg = *legs[i];
    const Step step = step_of(gait, i, cycle);
    const FootLength foot = foot_length(body, leg);
    const double pitch = legs.size() > 4 ? 0.0 : step.pitch;
    const double radians = std::abs(pitch) * kPi / 180.0;
    const double raised = std::sin(radians) * (pitch > 0.0 ? foot.toes : foot.heel);
    const Vector3d ankle = neutral_ankle(body, leg) + step.along * body.figure.forward + (step.up + raised) * kUp;
    poser.place_foot(leg, ankle, Quaterniond(AngleAxisd(pitch * kPi / 180.0, body.figure.left)));
  }
}

void plant_feet(Poser& poser) {
  for (const Limb* leg : legs_of(poser.body()))
    poser.place_foot(*leg, neutral_ankle(poser.body(), *leg), Quaterniond::Identity());
}

std::size_t upper_arm(const Body& body, const Limb& arm) {
  const auto bone = [&](std::size_t k) {
    return (bind_place(body, arm.joints[k + 1]) - bind_place(body, arm.joints[k])).norm();
  };
  double longest = 0.0;
  for (std::size_t k = 0; k + 1 < arm.joints.size(); ++k) longest = std::max(longest, bone(k));
  std::size_t upper = 0;
  while (upper + 2 < arm.joints.size() && bone(upper) < 0.6 * longest) ++upper;
  return upper;
}

Quaterniond lowering_turn(const Body& body, const Limb& arm) {
  const Figure& figure = body.figure;
  const Vector3d shoulder = bind_place(body, arm.joints[upper_arm(body, arm)]), way = arm.tip - shoulder;
  const double length = way.norm();
  if (arm.side == 0 || arm.joints.size() < 2 || !(length > 0.0)) return Quaterniond::Identity();
  std::vector<bool> is_arm(figure.joints(), false);
  for (const int other : body.of_kind(LimbKind::kArm)) {
    for (const int j : figure.subtree(body.limbs[at(other)].joints.front())) is_arm[at(j)] = true;
  }
  double width = 0.0;  // of the body beside which the arm hangs
  for (std::size_t j = 0; j < figure.joints(); ++j) {
    if (is_arm[j]) continue;
    for (const Vector3d& p : figure.surface[j]) {
      const bool beside = p.z() < shoulder.z() - 0.15 * length && p.z() > shoulder.z() - 0.9 * length &&
                          std::abs(figure.forward.dot(p - shoulder)) < 0.3 * length;
      if (beside) width = std::max(width, std::abs(figure.left.dot(p) - figure.middle));
    }
  }
  const double aside = std::abs(figure.left.dot(shoulder) - figure.middle);
  const double degree = kPi / 180.0;
  const double angle = std::clamp(std::atan2(width - aside, 0.6 * length) + 8.0 * degree, 10.0 * degree, 45.0 * degree);
  const double now = std::acos(std::clamp(-way.z() / length, -1.0, 1.0));
  if (now < angle + 12.0 * degree) return Quaterniond::Identity();
  const Vector3d outward = arm.side * figure.left;
  return Quaterniond::FromTwoVectors(way, std::sin(angle) * outward - std::cos(angle) * kUp);
}

void bend_elbow(Poser& poser, const Limb& arm, double degrees) {
  const std::size_t elbow = upper_arm(poser.body(), arm) + 1;
  if (elbow >= arm.joints.size()) return;
  // The upper arm carries the axis along when it is lowered.
  const Vector3d axis = lowering_turn(poser.body(), arm).conjugate() * poser.body().figure.left;
  poser.turn(arm.joints[elbow], axis, -degrees);
}

void lower_arms(Poser& poser) {
  const Body& body = poser.body();
  if (!body.is_upright()) return;
  for (const int i : body.of_kind(LimbKind::kArm)) {
    const Limb& arm = body.limbs[at(i)];
    poser.turn(arm.joints[upper_arm(body, arm)], lowering_turn(body, arm));
  }
}

BodyMotion gait_motion(const Body& body, const std::string& word, const MotionOptions& options) {
  const Gait gait = gait_of(body, word == "run");
  const double length = body.leg_length();
  BodyMotion motion;
  motion.name = word;
  motion.times = key_times(gait.seconds, options);
  const Vector3d velocity = gait.stride / gait.seconds * options.speed * body.figure.forward;
  if (!options.travel) motion.ground_velocity = -velocity;
  for (const int i : body.of_kind(LimbKind::kLeg)) {
    if (body.limbs[at(i)].partner >= 0) motion.contacts.push_back({i, {}});
  }
  std::vector<int> number(body.limbs.size(), -1);
  int next = 0;
  for (const auto& pair : body.leg_pairs()) {
    number[at(pair[0])] = next++;
    number[at(pair[1])] = next++;
  }
  const std::size_t count = motion.times.size();
  for (std::size_t f = 0; f < count; ++f) {
    const double cycle = f + 1 == count ? 0.0 : static_cast<double>(f) / static_cast<double>(count - 1);
    Poser poser(body);
    lower_arms(poser);
    pose_trunk(poser, gait, cycle, length);
    if (body.is_upright()) swing_arms(poser, cycle, gait.runs ? 38.0 : 24.0, gait.runs ? 60.0 : 12.0);
    sway_tails(poser, cycle, gait.runs ? 24.0 : 16.0);
    place_feet(poser, gait, cycle);
    JointMotions pose = poser.motions();
    if (options.travel) {
      for (metrics::RigidMotion& one : pose) one.shift += motion.times[f] * velocity;
    }
    motion.poses.push_back(std::move(pose));
    for (FootContact& contact : motion.contacts)
      contact.stands.push_back(stands(gait, at(number[at(contact.leg)]), cycle));
  }
  return motion;
}

}  // namespace anigen::motions
