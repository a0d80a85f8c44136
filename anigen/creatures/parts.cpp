#include "anigen/creatures/parts.h"

#include <cmath>

namespace anigen::creatures {

using Eigen::Vector3d;

void add_eyes(Body& body, int joint, const Vector3d& center, double apart, double radius, const Vector3d& look) {
  const int paint = body.add_paint(eye_paint(body.rng));
  for (int side : {1, -1}) {
    const Vector3d out(side * apart, 0, 0);
    body.eye(joint, center + out, radius, look + Vector3d(0.35 * side, 0, 0), paint);
  }
}

void add_horns(Body& body, int joint, const Vector3d& base, double apart, double length, double radius) {
  Paint horn = plain(color_of(body.between(0.08, 0.13), 0.25, body.between(0.4, 0.95)));
  horn.pattern = Paint::Pattern::kBands;
  horn.accent = 0.4 * horn.base;
  horn.along = Vector3d::UnitZ();
  horn.frequency = 4.0 / length;
  const int paint = body.add_paint(horn);
  const double back = body.between(-0.3, 1.0), outwards = body.between(0.2, 1.0);
  for (int side : {1, -1}) {
    const Vector3d from = base + Vector3d(side * apart, 0, 0);
    const Vector3d middle = from + length * Vector3d(0.6 * side * outwards, 0.1, 0.5);
    const auto points = curve(from, middle, from + length * Vector3d(0.5 * side * outwards, 0.5 * back, 0.9), 3);
    const auto radii = taper(radius, 0.25 * radius, 3);
    for (int i = 0; i < 3; ++i) body.cone(joint, points[i], points[i + 1], radii[i], radii[i + 1], paint).blend *= 0.5;
  }
}

void add_ears(Body& body, int head, const Vector3d& base, double apart, const Vector3d& direction, double length,
              int paint) {
  const double width = body.between(0.25, 0.45) * length;
  for (int side : {1, -1}) {
    const Vector3d from = base + Vector3d(side * apart, 0, 0);
    const Vector3d along = Vector3d(side * direction.x(), direction.y(), direction.z()).normalized();
    const Vector3d to = from + length * along;
    const int ear = body.joint("ear_" + side_name(side), head, from, to, width);
    const Eigen::Matrix3d frame = frame_along(along, Vector3d(1, -0.3 * side, 0));
    body.ellipsoid(ear, from + 0.5 * length * along, {width, 0.35 * width, 0.58 * length}, paint, frame);
    body.swing(ear, Vector3d::UnitY(), 0.18, side > 0 ? 0.4 : 0.9);
    body.bend_randomly(ear, 0.15);
  }
}

std::vector<int> add_tail(Body& body, int parent, const TailShape& s, int paint) {
  const Vector3d to = s.from + s.length * s.direction.normalized() - Vector3d(0, 0, s.droop * s.length);
  const auto points = curve(s.from, s.from + 0.5 * s.length * s.direction.normalized(), to, s.segments);
  const auto tail = body.limb(parent, numbered("tail", s.segments), points, taper(s.radius, s.tip, s.segments), paint);
  for (std::size_t i = 0; i < tail.size(); ++i) {
    body.bend(tail[i], Vector3d::UnitZ(), 0.12 * body.rng.normal());
    body.swing(tail[i], Vector3d::UnitZ(), 0.5 / s.segments + 0.06, -0.7 * static_cast<double>(i));
  }
  return tail;
}

int add_hand(Body& body, int parent, const std::string& prefix, const Vector3d& wrist, const Vector3d& out,
             const Vector3d& across, double size, int fingers, int segments, int paint) {
  const Vector3d x = out.normalized(), y = across.normalized();
  const Vector3d knuckles = wrist + 0.5 * size * x;
  const int hand = body.joint(prefix + "hand", parent, wrist, knuckles, 0.28 * size);
  Eigen::Matrix3d frame;
  frame << x, y, x.cross(y);
  if (fingers == 0) {
    body.ellipsoid(hand, wrist + 0.42 * size * x, {0.5 * size, 0.32 * size, 0.22 * size}, paint, frame);
    body.cone(hand, wrist + 0.25 * size * x + 0.2 * size * y, wrist + 0.55 * size * x + 0.42 * size * y, 0.12 * size,
              0.1 * size, paint);
    return hand;
  }
  body.ellipsoid(hand, wrist + 0.3 * size * x, {0.38 * size, 0.36 * size, 0.15 * size}, paint, frame);
  static const char* const kNames[] = {"thumb", "index", "middle", "ring", "pinky"};
  const double radius = 0.085 * size;
  for (int f = 0; f < fingers; ++f) {
    Vector3d from, direction;
    double length = 0.5 * size;
    if (f == 0) {
      from = wrist + 0.2 * size * x + 0.24 * size * y;
      direction = 0.7 * x + 0.7 * y;
      length *= 0.85;
    } else {
      const double at = fingers == 2 ? -0.1 : 0.3 - 0.6 * (f - 1.0) / (fingers - 2.0);
      from = knuckles + at * size * y - 0.08 * size * std::abs(at) * x;
      direction = x + 0.55 * at * y;
      length *= 1.05 - std::abs(at - 0.05);
    }
    direction.normalize();
    const auto points = curve(from, from + 0.5 * length * direction, from + length * direction, segments);
    const auto chain =
        body.limb(hand, numbered(prefix + kNames[f], segments), points, taper(radius, 0.8 * radius, segments), paint);
    const double curl = body.between(0.0, 0.35);
    for (int j : chain) {
      body.scale_blends(j, 0.6);
      body.bend(j, y, f == 0 ? 0.3 * curl : curl * (x.x() >= 0 ? 1.0 : -1.0));
    }
  }
  return hand;
}

std::vector<int> add_leg(Body& body, int parent, const std::string& prefix, const std::vector<std::string>& names,
                         const std::vector<Vector3d>& points, const std::vector<double>& radii, int paint) {
  std::vector<std::string> full;
  for (const std::string& name : names) full.push_back(prefix + name);
  return body.limb(parent, full, points, radii, paint);
}

void add_rig_habits(Body& body, const std::vector<int>& limbs, const std::vector<int>& tips, int most) {
  const auto room = [&] { return static_cast<int>(body.joints.size()) < most; };
  if (body.rng.chance(0.25)) {
    const int helpers = body.count(1, 2);
    for (int limb : limbs) {
      for (int k = 1; k <= helpers && room(); ++k) {
        body.twist_joint(body.joints[limb].name + "_twist" + (helpers > 1 ? "_0" + std::to_string(k) : ""), limb,
                         static_cast<double>(k) / (helpers + 1));
      }
    }
  }
  if (body.rng.chance(0.3)) {
    for (int tip : tips) {
      if (room()) body.end_joint(body.joints[tip].name + "_end", tip);
    }
  }
}

int maybe_ground_root(Body& body, double probability) {
  if (!body.rng.chance(probability)) return -1;
  const int root = body.joint("root", -1, Vector3d::Zero(), Vector3d(0, 0, 0.2), 0.1);
  body.joints[root].carries_skin = false;
  return root;
}

std::vector<int> add_feathered_wing(Body& body, int parent, int side, const WingShape& w, int bone, int feathers) {
  const Vector3d elbow = w.at(side, 0.3, 0.1, 0.05), wrist = w.at(side, 0.6, -0.02, 0.06);
  const Vector3d tip = w.at(side, 1.0, w.sweep, 0.03);
  const std::string name = "wing_" + side_name(side);
  const auto wing =
      body.limb(parent, {name + "_upper", name + "_lower", name + "_hand"}, {w.shoulder, elbow, wrist, tip},
                {w.radius, 0.8 * w.radius, 0.65 * w.radius, 0.4 * w.radius}, bone);
  const Vector3d back(0, w.chord, -0.1 * w.chord);
  const Vector3d root = w.shoulder + 0.95 * back, behind_elbow = elbow + 0.9 * back, behind_wrist = wrist + 0.95 * back;
  const Vector3d behind_tip = tip + 0.35 * back;
  const auto vane = [&](int owner, const Vector3d& a, const Vector3d& b, const Vector3d& c) {
    body.sheet({owner, owner, owner}, {a, b, c}, w.thickness, feathers, {}).blend = 0.5 * w.thickness;
  };
  vane(wing[0], w.shoulder, elbow, behind_elbow);
  vane(wing[0], w.shoulder, behind_elbow, root);
  vane(wing[1], elbow, wrist, behind_wrist);
  vane(wing[1], elbow, behind_wrist, behind_elbow);
  vane(wing[2], wrist, tip, behind_wrist);
  vane(wing[2], tip, behind_tip, behind_wrist);
  return wing;
}

std::vector<int> add_skin_wing(Body& body, int parent, int side, const WingShape& w, int fingers, int bone, int skin) {
  const std::string name = "wing_" + side_name(side);
  const Vector3d elbow = w.at(side, 0.22, 0.12, 0.16), wrist = w.at(side, 0.45, -0.04, 0.26);
  std::vector<int> wing = body.limb(parent, {name + "_upper", name + "_lower"}, {w.shoulder, elbow, wrist},
                                    {w.radius, 0.8 * w.radius, 0.65 * w.radius}, bone);
  std::vector<Vector3d> tips;
  std::vector<int> first, last;
  for (int f = 0; f < fingers; ++f) {
    const double turn = (f + 0.15) / fingers * 1.7;  // from outwards to backwards
    const Vector3d direction(side * std::cos(turn), std::sin(turn) * 0.9, -0.12 - 0.18 * turn);
    const double length = w.span * (0.68 - 0.1 * turn) * (w.chord / w.span + 0.35);
    const Vector3d middle = wrist + 0.5 * length * direction + Vector3d(0, 0, 0.05 * w.span);
    const Vector3d tip = wrist + length * direction;
    const std::string finger = name + "_finger_0" + std::to_string(f + 1);
    const auto chain = body.limb(wing[1], {finger + "_a", finger + "_b"}, {wrist, middle, tip},
                                 {0.5 * w.radius, 0.4 * w.radius, 0.3 * w.radius}, bone);
    first.push_back(chain[0]);
    last.push_back(chain[1]);
    tips.push_back(tip);
    wing.insert(wing.end(), chain.begin(), chain.end());
  }
  const auto skin_between = [&](const std::array<int, 3>& anchors, const std::array<Vector3d, 3>& corners,
                                const std::vector<int>& owners) {
    body.sheet(anchors, corners, w.thickness, skin, owners).blend = 0.8 * w.thickness;
  };
  for (int f = 0; f + 1 < fingers; ++f) {
    // The free edge sags inwards between two fingertips.
    const Vector3d knee_a = body.joints[last[f]].position, knee_b = body.joints[last[f + 1]].position;
    const Vector3d edge = 0.4 * (tips[f] + tips[f + 1]) + 0.2 * wrist;
    const std::vector<int> owners{first[f], last[f], first[f + 1], last[f + 1]};
    skin_between({first[f], first[f], first[f + 1]}, {wrist, knee_a, knee_b}, owners);
    skin_between({last[f], last[f + 1], last[f]}, {knee_a, knee_b, edge}, owners);
    skin_between({last[f], last[f], last[f]}, {knee_a, tips[f], edge}, owners);
    skin_between({last[f + 1], last[f + 1], last[f + 1]}, {knee_b, tips[f + 1], edge}, owners);
  }
  const Vector3d root = w.shoulder + Vector3d(0, 0.9 * w.chord, -0.1 * w.span);
  const Vector3d knee = body.joints[last.back()].position, edge = 0.35 * (root + tips.back()) + 0.3 * elbow;
  const std::vector<int> owners{wing[0], wing[1], first.back(), last.back()};
  skin_between({wing[0], wing[0], wing[0]}, {w.shoulder, elbow, root}, {wing[0]});
  skin_between({wing[0], wing[0], wing[1]}, {root, elbow, edge}, {wing[0], wing[1]});
  skin_between({wing[1], wing[1], last.back()}, {elbow, wrist, knee}, owners);
  skin_between({wing[1], last.back(), wing[1]}, {elbow, knee, edge}, owners);
  skin_between({last.back(), last.back(), wing[1]}, {knee, tips.back(), edge}, owners);
  return wing;
}

}  // namespace anigen::creatures
