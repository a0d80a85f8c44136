#include "anigen/motions/gestures.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/numeric.h"
#include "anigen/motions/gaits.h"

namespace anigen::motions {

namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

const Vector3d kVertical = Vector3d::UnitZ();

double wave(double cycle) { return std::sin(2.0 * kPi * cycle); }

double ease(double x) {
  x = std::clamp(x, 0.0, 1.0);
  return x * x * (3.0 - 2.0 * x);
}

/// 0 outside [from, to], 1 well inside.
double window(double x, double from, double rise, double fall, double to) {
  return ease((x - from) / rise) * ease((to - x) / fall);
}

/// Neck and head, without the back of rigs that name no neck.
std::vector<int> neck_of(const Limb& head) {
  const std::size_t count = std::min<std::size_t>(head.joints.size(), 4);
  return {head.joints.end() - static_cast<std::ptrdiff_t>(count), head.joints.end()};
}

void turn_heads(Poser& poser, const Vector3d& axis, double degrees) {
  const Body& body = poser.body();
  for (const int i : body.of_kind(LimbKind::kHead)) turn_line(poser, neck_of(body.limbs[at(i)]), axis, degrees);
}

std::vector<double> places_along(const Body& body) {
  std::vector<double> places = {0.0};
  for (std::size_t i = 1; i < body.axis.size(); ++i) {
    const auto& p = body.figure.tree.positions;
    places.push_back(places.back() + (p[at(body.axis[i])] - p[at(body.axis[i - 1])]).norm());
  }
  for (double& place : places) place /= std::max(places.back(), 1e-12);
  return places;
}

/// A wave that runs from head to tail: the part at place s of the axis has the heading amplitude(s) · sin 2π(c − k s).
template <typename Amplitude>
void run_wave(Poser& poser, double cycle, double waves, const Vector3d& about, Amplitude amplitude) {
  const Body& body = poser.body();
  const std::vector<double> places = places_along(body);
  std::vector<double> heading(body.figure.joints(), 0.0);
  std::vector<bool> is_axis(body.figure.joints(), false);
  for (std::size_t i = 0; i < body.axis.size(); ++i) {
    heading[at(body.axis[i])] = amplitude(places[i]) * wave(cycle - waves * places[i]);
    is_axis[at(body.axis[i])] = true;
  }
  for (const int j : body.axis) {
    const int above = body.figure.tree.parents[at(j)];
    const double carried = above >= 0 && is_axis[at(above)] ? heading[at(above)] : 0.0;
    poser.turn(j, about, heading[at(j)] - carried);
  }
}

/// Keeps the middle of the axis in its place aside.
void keep_centred(Poser& poser) {
  const Body& body = poser.body();
  const JointMotions motions = poser.motions();
  double aside = 0.0;
  for (const int j : body.axis) {
    const Vector3d& here = body.figure.tree.positions[at(j)];
    aside += body.figure.left.dot(motions[at(j)](here) - here) / static_cast<double>(body.axis.size());
  }
  poser.shift(-aside * body.figure.left);
}

/// Whales beat their flukes up and down, fish their fins aside.
bool beats_up_and_down(const Body& body) {
  if (body.axis.size() < 2 || body.is_snake()) return false;
  const Figure& figure = body.figure;
  Box box;
  for (std::size_t i = body.axis.size() - 2; i < body.axis.size(); ++i) {
    for (const int j : figure.subtree(body.axis[i])) {
      for (const Vector3d& p : figure.surface[at(j)]) box.extend({figure.left.dot(p), figure.forward.dot(p), p.z()});
    }
  }
  if (box.empty()) return false;
  const Vector3d extent = box.high - box.low;
  return extent.x() > 1.4 * extent.z() && extent.x() > 0.08 * figure.size;
}

void beat_fins(Poser& poser, double cycle, double degrees, LimbKind kind) {
  const Body& body = poser.body();
  for (const int i : body.of_kind(kind)) {
    const Limb& fin = body.limbs[at(i)];
    for (std::size_t k = 0; k < fin.joints.size(); ++k) {
      const double share = k == 0 ? 1.0 : 0.5;
      poser.turn(fin.joints[k], body.figure.forward,
                 (fin.side >= 0 ? 1.0 : -1.0) * share * degrees * wave(cycle - 0.12 * static_cast<double>(k)));
    }
  }
}

double longest_fin(const Body& body) {
  double length = 0.0;
  for (const int i : body.of_kind(LimbKind::kFin)) {
    const Limb& fin = body.limbs[at(i)];
    length = std::max(length, (fin.tip - body.figure.tree.positions[at(fin.joints.front())]).norm());
  }
  return length / body.figure.size;
}

void sway_chains(Poser& poser, double cycle, double degrees) {
  const Body& body = poser.body();
  std::size_t number = 0;
  for (const int i : body.of_kind(LimbKind::kChain)) {
    const std::vector<int>& joints = body.limbs[at(i)].joints;
    const double each = degrees / std::sqrt(static_cast<double>(joints.size()));
    for (std::size_t k = 0; k < joints.size(); ++k) {
      const double lag = cycle - 0.06 * static_cast<double>(k) - 0.17 * static_cast<double>(number);
      poser.turn(joints[k], body.figure.forward, each * wave(lag));
      poser.turn(joints[k], body.figure.left, 0.5 * each * wave(lag + 0.25));
    }
    ++number;
  }
}

/// Parts of bodies without any limb turn a little about the root, which stays.
void stir_parts(Poser& poser, double cycle) {
  const Body& body = poser.body();
  std::size_t number = 0;
  for (const int j : body.figure.children[at(body.root)]) {
    if (body.figure.mass_below[at(j)] < 1e-3 || number > 8) continue;
    poser.turn(j, body.figure.forward, 2.0 * wave(cycle - 0.15 * static_cast<double>(number++)));
  }
  if (number == 0) poser.shift(0.01 * body.figure.size * wave(cycle) * kVertical);
}

void breathe(Poser& poser, double cycle, double strength) {
  const Body& body = poser.body();
  const double length = body.leg_length();
  const double out = 0.5 - 0.5 * std::cos(2.0 * kPi * cycle);
  poser.shift(-strength * (0.012 + 0.012 * out) * length * kVertical);
  if (body.trunk.size() > 1) poser.turn(body.trunk.back(), body.figure.left, strength * (1.2 * out - 0.6));
  for (const int i : body.of_kind(LimbKind::kArm)) {
    const Limb& arm = body.limbs[at(i)];
    if (arm.side == 0) continue;
    poser.turn(arm.joints[upper_arm(body, arm)], body.figure.forward, strength * 1.5 * out * arm.side);
    if (body.is_upright()) bend_elbow(poser, arm, 8.0 + 2.0 * out);
  }
}

/// Height of a jumping body, in leg lengths, and how far its feet leave the ground.
struct Leap {
  double body = 0.0, feet = 0.0;
};

Leap leap_at(double cycle) {
  constexpr double kOff = 0.36, kDown = 0.72, kHigh = 0.55, kCrouch = 0.28;
  if (cycle < kOff) {
    // Down, and up again until the feet leave.
    const double crouch = cycle < 0.24 ? ease(cycle / 0.24) : 1.0 - ease((cycle - 0.24) / (kOff - 0.24));
    return {-kCrouch * crouch, 0.0};
  }
  if (cycle < kDown) {
    const double s = (cycle - kOff) / (kDown - kOff), height = 4.0 * kHigh * s * (1.0 - s);
    return {height, height + 0.12 * std::sin(kPi * s)};
  }
  const double s = (cycle - kDown) / (1.0 - kDown);
  return {-0.8 * kCrouch * (s < 0.35 ? ease(s / 0.35) : 1.0 - ease((s - 0.35) / 0.65)), 0.0};
}

void place_all_feet(Poser& poser, double height, double pitch) {
  const Body& body = poser.body();
  for (const auto& pair : body.leg_pairs()) {
    for (const int i : pair) {
      const Limb& leg = body.limbs[at(i)];
      poser.place_foot(leg, neutral_ankle(body, leg) + height * kVertical,
                       Quaterniond(Eigen::AngleAxisd(pitch * kPi / 180.0, body.figure.left)));
    }
  }
}

}  // namespace

void pose_idle(Poser& poser, double cycle) {
  const Body& body = poser.body();
  if (!body.leg_pairs().empty()) {
    lower_arms(poser);
    breathe(poser, cycle, 1.0);
    if (body.is_upright()) poser.shift(0.012 * body.leg_length() * wave(cycle) * body.figure.left);
    turn_heads(poser, kVertical, 4.0 * wave(cycle));
    turn_heads(poser, body.figure.left, 1.5 * wave(cycle + 0.3));
    sway_tails(poser, cycle, 14.0);
    beat_fins(poser, cycle, 3.0, LimbKind::kWing);
    sway_chains(poser, cycle, 3.0);
    plant_feet(poser);
    return;
  }
  const bool flies = !body.of_kind(LimbKind::kWing).empty();
  if (flies) {
    beat_fins(poser, 3.0 * cycle, 22.0, LimbKind::kWing);
    poser.shift(0.015 * body.figure.size * wave(3.0 * cycle + 0.5) * kVertical);
  } else if (body.is_snake()) {
    run_wave(poser, cycle, 1.0, kVertical, [](double s) { return 5.0 + 5.0 * s; });
    keep_centred(poser);
    turn_heads(poser, kVertical, 6.0 * wave(cycle));
    return;
  } else if (!body.axis.empty()) {
    const Vector3d about = beats_up_and_down(body) ? body.figure.left : kVertical;
    run_wave(poser, 2.0 * cycle, 0.7, about, [](double s) { return 2.0 + 9.0 * s * s; });
    beat_fins(poser, 2.0 * cycle, 8.0, LimbKind::kFin);
    poser.shift(0.01 * body.figure.size * wave(cycle) * kVertical);
    return;
  }
  turn_heads(poser, kVertical, 4.0 * wave(cycle));
  sway_tails(poser, cycle, 10.0);
  sway_chains(poser, cycle, 5.0);
  if (!flies && body.limbs.empty()) stir_parts(poser, cycle);
  for (const int i : body.of_kind(LimbKind::kArm)) {
    const Limb& arm = body.limbs[at(i)];
    poser.turn(arm.joints.front(), body.figure.forward, 3.0 * wave(cycle) * (arm.side >= 0 ? 1.0 : -1.0));
  }
}

bool jump_stands(double cycle) { return !(leap_at(cycle).feet > 0.0); }

void pose_jump(Poser& poser, double cycle) {
  const Body& body = poser.body();
  const Leap leap = leap_at(cycle);
  const double length = body.leg_length();
  lower_arms(poser);
  poser.shift((leap.body - 0.02) * length * kVertical);
  const double crouch = std::max(0.0, -leap.body / 0.28), air = leap.feet > 0.0 ? leap.body / 0.55 : 0.0;
  if (body.is_upright()) {
    poser.turn(body.root, body.figure.left, 20.0 * crouch);
    poser.shift(-0.12 * crouch * length * body.figure.forward);
  }
  for (const int i : body.of_kind(LimbKind::kArm)) {
    const Limb& arm = body.limbs[at(i)];
    if (arm.side != 0 && body.is_upright())
      poser.turn(arm.joints[upper_arm(body, arm)], body.figure.left, 45.0 * crouch - 95.0 * air);
  }
  beat_fins(poser, 0.25, 30.0 * air, LimbKind::kWing);
  sway_tails(poser, cycle, 10.0);
  place_all_feet(poser, leap.feet * length, 25.0 * air);
}

void pose_swim(Poser& poser, double cycle) {
  const Body& body = poser.body();
  const bool by_fins = longest_fin(body) > 0.25;
  if (!body.axis.empty()) {
    const Vector3d about = beats_up_and_down(body) ? body.figure.left : kVertical;
    const double strength = by_fins ? 0.35 : 1.0;
    run_wave(poser, cycle, 0.8, about, [&](double s) { return strength * (4.0 + 26.0 * s * s); });
    if (about == kVertical) keep_centred(poser);
  }
  beat_fins(poser, cycle, by_fins ? 26.0 : 16.0, LimbKind::kFin);
  poser.shift(0.008 * body.figure.size * wave(cycle) * kVertical);
}

double slither_stride(const Body& body) {
  double length = 0.0;
  const auto& p = body.figure.tree.positions;
  for (std::size_t i = 1; i < body.axis.size(); ++i) length += (p[at(body.axis[i])] - p[at(body.axis[i - 1])]).norm();
  return 0.85 * length / 1.5;  // mean cosine of the headings, over the waves on the body
}

void pose_slither(Poser& poser, double cycle) {
  run_wave(poser, cycle, 1.5, kVertical, [](double s) { return 44.0 * std::min(1.0, 0.35 + 2.0 * s); });
  keep_centred(poser);
}

void pose_fly(Poser& poser, double cycle) {
  const Body& body = poser.body();
  beat_fins(poser, cycle, 36.0, LimbKind::kWing);
  poser.shift(-0.035 * body.figure.size * wave(cycle) * kVertical);
  lower_arms(poser);
  for (const auto& pair : body.leg_pairs()) {
    for (const int i : pair) {
      const Limb& leg = body.limbs[at(i)];
      poser.turn(leg.joints[leg.hip], body.figure.left, 32.0 + 3.0 * wave(cycle));
    }
  }
  if (body.leg_pairs().empty()) sway_chains(poser, cycle, 4.0);
  for (const int i : body.of_kind(LimbKind::kTail))
    turn_line(poser, body.limbs[at(i)].joints, body.figure.left, 6.0 * wave(cycle + 0.3));
  turn_heads(poser, body.figure.left, 3.0 * wave(cycle + 0.5));
}

void pose_wave(Poser& poser, double cycle) {
  const Body& body = poser.body();
  const Figure& figure = body.figure;
  breathe(poser, cycle, 0.6);
  const std::vector<int> arms = body.of_kind(LimbKind::kArm);
  int waving = arms.front();
  for (const int i : arms) {
    if (body.limbs[at(i)].side < 0) {
      waving = i;
      break;
    }
  }
  const double raised = window(cycle, 0.0, 0.2, 0.2, 1.0);
  for (const int i : arms) {
    const Limb& arm = body.limbs[at(i)];
    const std::size_t upper = upper_arm(body, arm);
    const Quaterniond low = body.is_upright() ? lowering_turn(body, arm) : Quaterniond::Identity();
    if (i != waving) {
      poser.turn(arm.joints[upper], low);
      continue;
    }
    const Vector3d outward = (arm.side >= 0 ? 1.0 : -1.0) * figure.left;
    const Vector3d shoulder = figure.tree.positions[at(arm.joints[upper])];
    const bool has_elbow = arm.joints.size() > upper + 1;
    const Vector3d elbow = has_elbow ? figure.tree.positions[at(arm.joints[upper + 1])] : arm.tip;
    const double swing = 24.0 * wave(3.0 * cycle) * kPi / 180.0;
    const Vector3d up_arm = (outward + (has_elbow ? 0.25 : 1.2 + std::tan(swing)) * kVertical).normalized();
    const Quaterniond high = Quaterniond::FromTwoVectors(elbow - shoulder, up_arm);
    poser.turn(arm.joints[upper], low.slerp(raised, high));
    if (!has_elbow) continue;
    const Vector3d fore = (std::cos(swing) * kVertical + std::sin(swing + 0.2) * outward + 0.15 * figure.forward);
    const Quaterniond wanted = Quaterniond::FromTwoVectors(arm.tip - elbow, fore.normalized());
    poser.turn(arm.joints[upper + 1], Quaterniond::Identity().slerp(raised, high.conjugate() * wanted));
  }
  turn_heads(poser, figure.forward, -4.0 * raised * wave(cycle));
  sway_tails(poser, cycle, 10.0);
  plant_feet(poser);
}

void pose_wag(Poser& poser, double cycle) {
  const Body& body = poser.body();
  for (const int i : body.of_kind(LimbKind::kTail)) {
    const std::vector<int>& joints = body.limbs[at(i)].joints;
    const double each = 60.0 / static_cast<double>(joints.size() + 1);
    for (std::size_t k = 0; k < joints.size(); ++k)
      poser.turn(joints[k], kVertical, each * wave(cycle - 0.08 * static_cast<double>(k)));
  }
  if (body.leg_pairs().size() > 1) poser.turn(body.trunk.front(), kVertical, 2.5 * wave(cycle + 0.1));
  lower_arms(poser);
  plant_feet(poser);
}

void pose_look(Poser& poser, double cycle) {
  const Body& body = poser.body();
  lower_arms(poser);
  breathe(poser, 2.0 * cycle, body.leg_pairs().empty() ? 0.0 : 0.6);
  // To the left, a moment there, to the right, a moment there.
  const double side = window(cycle, 0.0, 0.15, 0.15, 0.5) - window(cycle, 0.5, 0.15, 0.15, 1.0);
  turn_heads(poser, kVertical, 42.0 * side);
  sway_tails(poser, cycle, 8.0);
  plant_feet(poser);
}

void pose_nod(Poser& poser, double cycle) {
  const Body& body = poser.body();
  lower_arms(poser);
  turn_heads(poser, body.figure.left, 8.0 * (1.0 - std::cos(4.0 * kPi * cycle)));
  plant_feet(poser);
}

void pose_dance(Poser& poser, double cycle) {
  const Body& body = poser.body();
  const Figure& figure = body.figure;
  const double length = body.leg_length(), beat = std::abs(wave(2.0 * cycle));
  lower_arms(poser);
  poser.shift(-(0.02 + 0.09 * beat) * length * kVertical + 0.09 * length * wave(cycle) * figure.left);
  poser.turn(body.root, figure.forward, -5.0 * wave(cycle));
  poser.turn(body.root, kVertical, 6.0 * wave(cycle + 0.25));
  if (body.trunk.size() > 1) {
    turn_line(poser, {body.trunk.begin() + 1, body.trunk.end()}, figure.forward, 10.0 * wave(cycle));
    turn_line(poser, {body.trunk.begin() + 1, body.trunk.end()}, kVertical, -10.0 * wave(cycle + 0.25));
  }
  for (const int i : body.of_kind(LimbKind::kArm)) {
    const Limb& arm = body.limbs[at(i)];
    if (arm.side == 0) continue;
    const std::size_t upper = upper_arm(body, arm);
    poser.turn(arm.joints[upper], figure.left, -35.0 - 22.0 * arm.side * wave(2.0 * cycle));
    if (body.is_upright()) bend_elbow(poser, arm, 55.0);
  }
  turn_heads(poser, figure.forward, -6.0 * wave(cycle));
  sway_tails(poser, 2.0 * cycle, 26.0);
  beat_fins(poser, 2.0 * cycle, 10.0, LimbKind::kWing);
  plant_feet(poser);
}

void pose_spin(Poser& poser, double cycle) {
  const Body& body = poser.body();
  pose_idle(poser, 0.0);
  // About the vertical through the middle of the body, wherever the root stands.
  Vector3d centre = body.figure.box.center();
  const int root = body.figure.order.front();
  const Vector3d offset = body.figure.tree.positions[at(root)] - centre;
  const Quaterniond turn(Eigen::AngleAxisd(2.0 * kPi * cycle, kVertical));
  poser.turn(root, turn);
  poser.shift(turn * offset - offset);
}

void pose_sway(Poser& poser, double cycle) {
  const Body& body = poser.body();
  lower_arms(poser);
  if (body.of_kind(LimbKind::kChain).empty()) {
    const double each = 10.0 / static_cast<double>(body.trunk.size());
    for (const int j : body.trunk) poser.turn(j, body.figure.forward, each * wave(cycle));
  }
  sway_chains(poser, cycle, 14.0);
  sway_tails(poser, cycle, 20.0);
  plant_feet(poser);
}

}  // namespace anigen::motions
