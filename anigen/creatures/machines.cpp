#include <cmath>

#include "anigen/creatures/parts.h"

namespace anigen::creatures {

using Eigen::Vector3d;

namespace {

void make_rigid(Body& body) {
  body.machine = true;
  body.smoothness = 0.0;
  body.softness = body.rng.chance(0.7) ? 0.02 : body.between(0.05, 0.2);
  body.weight_smoothing = body.softness < 0.03 ? 0 : 1;
}

/// A hinge: a drum whose axis is `axis`, with caps in another paint.
void add_hinge(Body& body, int joint, const Vector3d& at, const Vector3d& axis, double radius, double half_width,
               int drum, int cap) {
  const Vector3d w = half_width * axis.normalized();
  body.cylinder(joint, at - w, at + w, radius, radius, 0.12 * radius, drum);
  body.cylinder(joint, at - 1.15 * w, at + 1.15 * w, 0.6 * radius, 0.6 * radius, 0.08 * radius, cap);
}

/// A link between two hinges, box or tube.
void add_link(Body& body, int joint, const Vector3d& from, const Vector3d& to, double half_width, double half_depth,
              bool tube, int paint, int trim) {
  const Eigen::Matrix3d frame = frame_along(to - from);
  if (tube) {
    body.cylinder(joint, from, to, half_width, 0.85 * half_width, 0.1 * half_width, paint);
    const Vector3d middle = 0.5 * (from + to), ring = 0.08 * (to - from);
    body.cylinder(joint, middle - ring, middle + ring, 1.15 * half_width, 1.15 * half_width, 0.05 * half_width, trim);
    return;
  }
  body.box(joint, 0.5 * (from + to), {half_width, half_depth, 0.5 * (to - from).norm()}, 0.2 * half_width, paint,
           frame);
  body.box(joint, 0.5 * (from + to), {1.12 * half_width, 0.5 * half_depth, 0.3 * (to - from).norm()}, 0.1 * half_width,
           trim, frame);
}

}  // namespace

void build_robot_arm(Body& body) {
  Rng& rng = body.rng;
  make_rigid(body);
  const int shell = body.add_paint(machine_paint(rng, true)), dark = body.add_paint(machine_paint(rng, false));
  const int metal = body.add_paint(plain(color_of(0.6, 0.04, body.between(0.3, 0.75))));
  const double width = body.between(0.08, 0.13);
  const bool tube = rng.chance(0.4);
  const double foot = body.between(0.24, 0.34);
  const int base = body.joint("base", -1, {0, 0, 0}, {0, 0, 0.15}, foot);
  if (rng.chance(0.5)) {
    body.cylinder(base, {0, 0, 0}, {0, 0, 0.08}, foot, foot, 0.015, dark);
  } else {
    body.box(base, {0, 0, 0.04}, {foot, foot, 0.04}, 0.015, dark);
  }
  body.cylinder(base, {0, 0, 0.05}, {0, 0, 0.17}, 0.75 * foot, 0.6 * foot, 0.015, metal);
  const double shoulder_height = 0.17 + 1.6 * width;
  const int turret = body.joint("turret", base, {0, 0, 0.16}, {0, 0, shoulder_height}, 0.6 * foot);
  body.cylinder(turret, {0, 0, 0.15}, {0, 0, 0.24}, 0.58 * foot, 0.58 * foot, 0.015, shell);
  for (int side : {1, -1})
    body.box(turret, {side * 1.35 * width, 0, shoulder_height - 0.3 * width}, {0.22 * width, 0.9 * width, 1.3 * width},
             0.05 * width, shell);
  body.swing(turret, Vector3d::UnitZ(), 0.5, 0.0);
  const int links = body.count(2, 4);
  int parent = turret;
  Vector3d at(0, 0, shoulder_height);
  double scale = 1.0;
  const auto names = numbered("link", links);
  for (int i = 0; i < links; ++i) {
    const double w = width * scale, length = body.between(0.4, 0.65) * (0.6 + 0.4 * scale);
    const Vector3d to = at + Vector3d(0, 0, length);
    parent = body.joint(names[i], parent, at, to, w);
    add_hinge(body, parent, at, Vector3d::UnitX(), 1.15 * w, 1.2 * w, dark, metal);
    add_link(body, parent, at + Vector3d(0, 0, 0.7 * w), to - Vector3d(0, 0, 0.45 * w), 0.75 * w, 0.7 * w, tube, shell,
             i % 2 ? dark : metal);
    body.bend(parent, Vector3d::UnitX(), i == 0 ? body.between(-0.5, 0.5) : body.between(0.4, 1.3));
    body.swing(parent, Vector3d::UnitX(), 0.22, -0.9 * i);
    at = to;
    scale *= 0.84;
  }
  const double w = width * scale;
  const int wrist = body.joint("wrist", parent, at, at + Vector3d(0, 0, 2.2 * w), w);
  add_hinge(body, wrist, at, Vector3d::UnitX(), 1.1 * w, 1.1 * w, dark, metal);
  body.cylinder(wrist, at + Vector3d(0, 0, 0.6 * w), at + Vector3d(0, 0, 2.0 * w), 0.8 * w, 0.8 * w, 0.08 * w, metal);
  body.bend(wrist, Vector3d::UnitX(), body.between(-0.4, 1.0));
  const Vector3d flange = at + Vector3d(0, 0, 2.0 * w);
  const int palm = body.joint("gripper", wrist, flange, flange + Vector3d(0, 0, 0.7 * w), w);
  body.cylinder(palm, flange - Vector3d(0, 0, 0.1 * w), flange + Vector3d(0, 0, 0.6 * w), 1.15 * w, 1.15 * w, 0.06 * w,
                dark);
  body.swing(palm, Vector3d::UnitZ(), 0.6, 0.7);
  const int fingers = body.count(2, 4), knuckles = body.count(1, 2);
  for (int f = 0; f < fingers; ++f) {
    const double a = 2.0 * 3.14159265358979 * f / fingers;
    const Vector3d out(std::cos(a), std::sin(a), 0), across(-std::sin(a), std::cos(a), 0);
    const Vector3d root = flange + 0.85 * w * out + Vector3d(0, 0, 0.5 * w);
    const Vector3d knee = root + 0.6 * w * out + Vector3d(0, 0, 0.9 * w),
                   tip = knee + Vector3d(0, 0, 1.1 * w) - 0.4 * w * out;
    const std::string name = "finger_0" + std::to_string(f + 1);
    const int first = body.joint(name + "_a", palm, root, knee, 0.3 * w);
    body.box(first, 0.5 * (root + knee), {0.3 * w, 0.25 * w, 0.62 * (knee - root).norm()}, 0.06 * w, shell,
             frame_along(knee - root, across));
    const int second = knuckles == 2 ? body.joint(name + "_b", first, knee, tip, 0.3 * w) : first;
    body.box(second, 0.5 * (knee + tip), {0.28 * w, 0.22 * w, 0.58 * (tip - knee).norm()}, 0.06 * w, dark,
             frame_along(tip - knee, across));
    const double open = body.between(-0.2, 0.3);
    body.bend(first, across, open);
    body.swing(first, across, 0.25, 0.0);
  }
  if (rng.chance(0.3)) body.end_joint("tool", palm);
}

void build_lamp(Body& body) {
  Rng& rng = body.rng;
  make_rigid(body);
  const bool bright = rng.chance(0.7);
  const Paint paint = machine_paint(rng, bright);
  const int shade_paint = body.add_paint(paint),
            arm_paint = body.add_paint(rng.chance(0.5) ? shade(paint, 0.6) : machine_paint(rng, false));
  const int metal = body.add_paint(plain(color_of(0.12, rng.chance(0.3) ? 0.5 : 0.03, body.between(0.45, 0.85))));
  const int bulb = body.add_paint(plain({1.0, 0.85, 0.45}));
  const double foot = body.between(0.2, 0.3), r = body.between(0.03, 0.045);
  const int base = body.joint("base", -1, {0, 0, 0}, {0, 0, 0.1}, foot);
  body.cylinder(base, {0, 0, 0}, {0, 0, 0.06}, foot, 0.92 * foot, 0.02, arm_paint);
  body.cylinder(base, {0, 0, 0.05}, {0, 0, 0.1}, 0.35 * foot, 0.25 * foot, 0.01, metal);
  const bool gooseneck = rng.chance(0.35);
  int parent = base;
  Vector3d at(0, 0, 0.1);
  if (gooseneck) {
    // A flexible neck: many short joints that blend softly.
    const int segments = body.count(5, 14);
    const double height = body.between(0.8, 1.2);
    const auto neck =
        body.limb(base, numbered("neck", segments),
                  curve(at, {0, 0, 1.3 * height}, {0, -0.55 * height, height}, segments), taper(r, r, segments), metal);
    body.swing_chain(neck, Vector3d::UnitX(), 0.35 / segments, 0.2);
    body.softness = body.between(0.6, 1.5);
    body.weight_smoothing = 2;
    parent = neck.back();
    at = body.joints[parent].tail;
  } else {
    const int links = body.count(2, 3);
    const bool twin = rng.chance(0.5);
    double lean = body.between(-0.5, 0.0);
    for (int i = 0; i < links; ++i) {
      const double length = body.between(0.4, 0.6);
      const Vector3d to = at + Vector3d(0, 0, length);
      parent =
          body.joint(links == 2 ? (i ? "arm_upper" : "arm_lower") : numbered("arm", links)[i], parent, at, to, 1.5 * r);
      add_hinge(body, parent, at, Vector3d::UnitX(), 1.9 * r, 2.2 * r, metal, arm_paint);
      for (int side : {1, -1}) {
        if (!twin && side < 0) continue;
        const Vector3d shift(twin ? 1.6 * r * side : 0.0, 0, 0);
        body.cylinder(parent, at + shift, to + shift, twin ? 0.7 * r : r, twin ? 0.7 * r : r, 0.1 * r, arm_paint);
      }
      body.bend(parent, Vector3d::UnitX(), lean);
      lean = body.between(0.5, 1.2);
      body.swing(parent, Vector3d::UnitX(), 0.15, -1.0 * i);
      at = to;
    }
  }
  // The shade opens along +Z of the plan and is then tipped over.
  const double open = body.between(0.18, 0.28), closed = body.between(0.06, 0.11), deep = body.between(0.22, 0.34);
  const Vector3d up =
      gooseneck ? (body.joints[parent].tail - body.joints[parent].position).normalized() : Vector3d(0, 0, 1);
  const int head = body.joint("shade", parent, at, at + deep * up, closed);
  if (!gooseneck) add_hinge(body, head, at, Vector3d::UnitX(), 1.7 * r, 2.0 * r, metal, arm_paint);
  const Vector3d neck = at + 1.2 * r * up, collar = neck + 0.25 * deep * up, mouth = neck + 1.1 * deep * up;
  body.cylinder(head, neck - 0.6 * r * up, collar + 0.05 * deep * up, closed, closed, 0.012, arm_paint);
  const double wall = 0.05;
  const bool drum = rng.chance(0.25);
  body.cylinder(head, collar, mouth, drum ? 0.85 * open : 1.15 * closed, open, 0.01, shade_paint);
  body.cylinder(head, collar + 0.2 * deep * up, mouth + 0.2 * deep * up,
                std::max((drum ? 0.85 * open : 1.4 * closed) - wall, 0.03), open + 0.15 * (open - closed) - wall, 0.0,
                shade_paint)
      .carve = true;
  body.cylinder(head, collar, collar + 0.35 * deep * up, 0.6 * closed, 0.6 * closed, 0.01, metal);
  body.ball(head, collar + 0.5 * deep * up, body.between(0.75, 0.95) * closed, bulb);
  if (!gooseneck) body.bend(head, Vector3d::UnitX(), body.between(0.3, 1.1));
  body.swing(head, Vector3d::UnitX(), 0.25, 1.2);
  body.swing(head, Vector3d::UnitZ(), 0.2, 0.0);
  if (rng.chance(0.3)) body.end_joint("shade_end", head);
  if (body.joints.size() < 4) body.end_joint("base_end", base);
}

}  // namespace anigen::creatures
