#include "anigen/prepare/creatures/families/parts.h"

#include <cmath>

namespace anigen::prepare {

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
      for (Primitive& p : body.primitives) {
        if (p.joint == j) p.blend *= 0.6;
      }
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

}  // namespace anigen::prepare
