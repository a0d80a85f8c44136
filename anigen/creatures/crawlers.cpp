#include <cmath>

#include "anigen/core/numeric.h"
#include "anigen/creatures/parts.h"

namespace anigen::creatures {

using Eigen::Vector3d;

namespace {

struct Legs {
  int pairs, segments;
  double reach, rise, radius, front, back;  ///< directions from `front` to `back`, radians from sideways
  double attach_length, attach_width, height;
};

std::string leg_name(int pair, int pairs, int side) {
  static const char* const kThree[] = {"front", "middle", "back"};
  return "leg_" + (pairs == 3 ? std::string(kThree[pair]) : "0" + std::to_string(pair + 1)) + "_" + side_name(side) +
         "_";
}

/// Arched legs on both sides of a thorax at the origin's (x, y).
void add_legs(Body& body, int thorax, const Legs& l, int paint, std::vector<int>& tips) {
  static const std::vector<std::string> kNames[] = {
      {"femur", "tibia"}, {"coxa", "femur", "tibia"}, {"coxa", "femur", "tibia", "tarsus"}};
  const double jitter = body.between(0.0, 0.15);
  for (int pair = 0; pair < l.pairs; ++pair) {
    const double t = l.pairs == 1 ? 0.5 : static_cast<double>(pair) / (l.pairs - 1);
    const double turn = l.front + (l.back - l.front) * t;
    const double reach = l.reach * (1.0 + 0.25 * std::abs(2.0 * t - 1.0));
    for (int side : {1, -1}) {
      const double s = side;
      const Vector3d out(s * std::cos(turn), -std::sin(turn), 0);
      const Vector3d from(s * 0.8 * l.attach_width, l.attach_length * (t - 0.5), l.height);
      const auto at = [&](double along, double up) {
        return Vector3d(from + along * reach * out + Vector3d(0, 0, up));
      };
      const double ground = -l.height + 0.6 * l.radius;
      std::vector<Vector3d> points;
      if (l.segments == 2) points = {from, at(0.42, l.rise), at(1.0, ground)};
      if (l.segments == 3) points = {from, at(0.14, 0.15 * l.rise), at(0.48, l.rise), at(1.0, ground)};
      if (l.segments == 4)
        points = {from, at(0.12, 0.1 * l.rise), at(0.42, l.rise), at(0.82, 0.6 * ground), at(1.05, ground)};
      const auto& names = kNames[l.segments - 2];
      const auto leg = add_leg(body, thorax, leg_name(pair, l.pairs, side), names, points,
                               taper(l.radius, 0.4 * l.radius, l.segments, 1.15), paint);
      for (int j : leg) {
        body.joints[j].radius = l.radius;
        body.scale_blends(j, 0.4);
      }
      body.bend(leg[0], Vector3d::UnitZ(), jitter * body.rng.normal());
      body.swing(leg[0], Vector3d::UnitZ(), 0.12, pair * 1.6 + (side > 0 ? 0.0 : 3.14));
      body.swing(leg[1], Vector3d(0, 1, 0), 0.08, pair * 1.6 + (side > 0 ? 1.5 : 4.6));
      tips.push_back(leg.back());
    }
  }
}

void add_feelers(Body& body, int head, const Vector3d& base, double apart, double length, double radius, int paint) {
  const int segments = body.count(1, 3);
  const double outwards = body.between(0.2, 0.8), rise = body.between(0.0, 0.9);
  for (int side : {1, -1}) {
    const Vector3d from = base + Vector3d(side * apart, 0, 0);
    const Vector3d to = from + length * Vector3d(side * outwards, -1.0, rise).normalized();
    const auto chain = body.limb(head, numbered("antenna_" + side_name(side), segments),
                                 curve(from, 0.5 * (from + to) + Vector3d(0, 0, 0.3 * length), to, segments),
                                 taper(radius, 0.7 * radius, segments), paint);
    for (int j : chain) body.swing(j, Vector3d::UnitX(), 0.15, side * 0.7);
  }
}

}  // namespace

void build_spider(Body& body) {
  Rng& rng = body.rng;
  const double thorax = body.between(0.19, 0.27), abdomen = thorax * body.between(0.9, 1.6);
  body.smoothness = 0.35;
  body.softness = body.between(0.12, 0.4);
  body.weight_smoothing = 1;
  const Paint coat = random_coat(rng, 0.8, rng.chance(0.5) ? Vector3d::UnitY() : Vector3d::UnitX());
  const int skin = body.add_paint(coat);
  Paint leg_paint = shade(coat, body.between(0.5, 1.1));
  if (rng.chance(0.5)) {
    leg_paint.pattern = Paint::Pattern::kBands;
    leg_paint.along = Vector3d::UnitX();
    leg_paint.frequency = body.between(4.0, 8.0);
    leg_paint.accent = 0.3 * leg_paint.base;
  }
  const int legs = body.add_paint(leg_paint);
  const double height = body.between(0.2, 0.35);
  const int root = body.joint("thorax", maybe_ground_root(body, 0.15), {0, 0, height}, {0, -thorax, height}, thorax);
  body.ellipsoid(root, {0, 0, height}, {0.85 * thorax, thorax, 0.55 * thorax}, skin);
  const Vector3d waist(0, 0.85 * thorax, height),
      end(0, 0.9 * thorax + 2.0 * abdomen, height + body.between(-0.05, 0.25));
  const int rear = body.joint("abdomen", root, waist, end, 0.4 * thorax);
  const Vector3d along = (end - waist).normalized();
  body.cone(rear, waist - 0.1 * along, waist + 0.1 * along, 0.25 * thorax, 0.25 * thorax, skin);
  body.ellipsoid(rear, 0.5 * (waist + end) + 0.03 * along, {0.82 * abdomen, 0.72 * abdomen, abdomen}, skin,
                 frame_along(along));
  body.swing(rear, Vector3d::UnitX(), 0.08, 0.0);
  std::vector<int> tips{rear};
  const int head = body.joint("head", root, {0, -0.7 * thorax, height}, {0, -1.4 * thorax, height}, 0.5 * thorax);
  body.ellipsoid(head, {0, -0.95 * thorax, height + 0.05 * thorax}, {0.5 * thorax, 0.45 * thorax, 0.45 * thorax}, skin);
  const int eyes = body.add_paint(plain(color_of(rng.uniform(), rng.uniform(0.0, 0.9), rng.uniform(0.02, 0.6))));
  for (int side : {1, -1}) {
    body.eye(head, {side * 0.16 * thorax, -1.35 * thorax, height + 0.22 * thorax}, 0.14 * thorax, {0, -1, 0}, eyes);
    body.eye(head, {side * 0.38 * thorax, -1.2 * thorax, height + 0.3 * thorax}, 0.1 * thorax, {0, -1, 0}, eyes);
    const Vector3d jaw(side * 0.2 * thorax, -1.25 * thorax, height - 0.2 * thorax);
    const int fang =
        body.joint("fang_" + side_name(side), head, jaw, jaw + Vector3d(0, -0.1, -0.25) * thorax, 0.15 * thorax);
    body.cone(fang, jaw, jaw + Vector3d(0, -0.25 * thorax, -0.35 * thorax), 0.18 * thorax, 0.1 * thorax, legs);
    body.swing(fang, Vector3d::UnitX(), 0.25, side * 1.0);
    tips.push_back(fang);
  }
  Legs l{4,
         body.count(3, 4),
         body.between(0.5, 0.75),
         body.between(0.12, 0.32),
         body.between(0.035, 0.06),
         body.between(0.7, 1.1),
         -body.between(0.7, 1.1),
         1.1 * thorax,
         0.75 * thorax,
         height};
  add_legs(body, root, l, legs, tips);
  add_rig_habits(body, {}, tips);
}

void build_insect(Body& body) {
  Rng& rng = body.rng;
  const bool ant = rng.chance(0.45), winged = !ant && rng.chance(0.6);
  const double size = 0.23, waist = ant ? 0.3 : body.between(0.7, 1.0);
  body.smoothness = 0.35;
  body.softness = body.between(0.1, 0.4);
  body.weight_smoothing = 1;
  const Paint coat = random_coat(rng, 0.9, Vector3d::UnitY());
  const int skin = body.add_paint(coat);
  const int legs = body.add_paint(shade(coat, body.between(0.2, 0.8)));
  const double height = body.between(0.18, 0.32);
  const double thorax = size * (ant ? 0.75 : body.between(0.8, 1.1));
  const int root = body.joint("thorax", maybe_ground_root(body, 0.15), {0, 0, height}, {0, -thorax, height}, thorax);
  body.ellipsoid(root, {0, 0, height}, {0.75 * thorax, 1.15 * thorax, 0.75 * thorax}, skin);
  std::vector<int> tips;
  // The abdomen, in one or several rings.
  const int rings = body.count(1, 4);
  const double belly = size * body.between(0.9, 1.4), droop = body.between(-0.25, 0.25);
  const Vector3d from(0, thorax, height), to = from + Vector3d(0, 2.3 * belly, -droop * belly);
  const auto points = curve(from, 0.5 * (from + to) + Vector3d(0, 0, 0.15 * belly), to, rings);
  int parent = root;
  for (int i = 0; i < rings; ++i) {
    parent = body.joint(numbered("abdomen", rings)[i], parent, points[i], points[i + 1], 0.7 * belly);
    body.swing(parent, Vector3d::UnitX(), 0.1 / rings, -0.5 * i);
    const double t = (i + 0.5) / rings;
    const double r = belly * (rings == 1 ? 0.85 : 0.95 - 1.1 * (t - 0.35) * (t - 0.35) * 1.6);
    const Vector3d along = (points[i + 1] - points[i]).normalized();
    body.ellipsoid(parent, 0.5 * (points[i] + points[i + 1]), {r, 0.85 * r, (rings == 1 ? 1.2 : 1.6 / rings) * belly},
                   skin, frame_along(along));
  }
  body.cone(body.joints[parent].parent, {0, 0.6 * thorax, height}, points[0] + Vector3d(0, 0.2 * belly, 0),
            waist * 0.7 * thorax, waist * 0.7 * thorax, skin);
  tips.push_back(parent);
  const double h = size * body.between(0.55, 0.85);
  const Vector3d neck(0, -1.0 * thorax, height + 0.02),
      face = neck + Vector3d(0, -0.8 * h, body.between(-0.2, 0.2) * h);
  const int head = body.joint("head", root, neck, face + Vector3d(0, -h, 0), 0.6 * h);
  body.cone(root, {0, -0.5 * thorax, height}, face, 0.4 * thorax, 0.45 * h, skin);
  body.ellipsoid(head, face, {0.95 * h, 0.9 * h, 0.8 * h}, skin);
  body.swing(head, Vector3d::UnitZ(), 0.12, 0.4);
  add_eyes(body, head, face + Vector3d(0, -0.4 * h, 0.25 * h), 0.72 * h, 0.33 * h, {0, -0.6, 0.2});
  add_feelers(body, head, face + Vector3d(0, -0.6 * h, 0.45 * h), 0.3 * h, body.between(0.25, 0.6), 0.026, legs);
  for (int side : {1, -1}) {
    const Vector3d hinge = face + Vector3d(side * 0.45 * h, -0.65 * h, -0.3 * h),
                   tip = face + Vector3d(side * 0.1 * h, -1.5 * h, -0.35 * h);
    const int jaw = body.joint("mandible_" + side_name(side), head, hinge, tip, 0.15 * h);
    body.cone(jaw, hinge, 0.5 * (hinge + tip) + Vector3d(side * 0.2 * h, 0, 0), 0.2 * h, 0.15 * h, legs);
    body.cone(jaw, 0.5 * (hinge + tip) + Vector3d(side * 0.2 * h, 0, 0), tip, 0.15 * h, 0.1 * h, legs);
    body.swing(jaw, Vector3d::UnitZ(), 0.2 * side, 0.0);
    tips.push_back(jaw);
  }
  Legs l{3,
         body.count(2, 4),
         body.between(0.35, 0.52),
         body.between(0.06, 0.18),
         body.between(0.03, 0.05),
         body.between(0.4, 0.9),
         -body.between(0.5, 1.0),
         1.5 * thorax,
         0.65 * thorax,
         height - 0.02};
  add_legs(body, root, l, legs, tips);
  if (winged) {
    Paint glass = plain(color_of(rng.uniform(0.45, 0.7), 0.2, 0.95));
    glass.pattern = Paint::Pattern::kMottled;
    glass.accent = color_of(rng.uniform(), 0.6, 0.9);
    glass.frequency = 8.0;
    const int wing_paint = body.add_paint(glass);
    const int pairs = body.count(1, 2);
    for (int pair = 0; pair < pairs; ++pair) {
      for (int side : {1, -1}) {
        const double s = side, span = body.between(0.6, 0.85) * (pair ? 0.75 : 1.0);
        const Vector3d base(s * 0.3 * thorax, (pair ? 0.45 : -0.15) * thorax, height + 0.6 * thorax);
        const Vector3d along = Vector3d(s, 0.45 + 0.5 * pair, 0.35).normalized(), tip = base + span * along;
        const std::string name = std::string("wing_") + (pair ? "back_" : "front_") + side_name(side);
        const int wing = body.joint(name, root, base, tip, 0.1);
        const Eigen::Matrix3d frame = frame_along(along, {0, 1, 0});
        body.ellipsoid(wing, base + 0.52 * span * along, {0.2 * span, 0.022, 0.5 * span}, wing_paint, frame).blend =
            0.01;
        body.cone(wing, base - 0.04 * along, base + 0.9 * span * along - 0.1 * span * frame.col(0), 0.03, 0.018, legs)
            .blend = 0.01;
        body.swing(wing, Vector3d::UnitY(), -0.5 * s, 0.9 * pair);
        body.bend(wing, Vector3d::UnitY(), s * body.between(-0.15, 0.1));
        tips.push_back(wing);
      }
    }
  }
  add_rig_habits(body, {}, tips);
}

void build_crab(Body& body) {
  Rng& rng = body.rng;
  const double width = body.between(0.38, 0.5), depth = width * body.between(0.6, 0.9),
               height = body.between(0.16, 0.28);
  body.smoothness = 0.3;
  body.softness = body.between(0.1, 0.45);
  body.weight_smoothing = 1;
  const Paint coat = random_coat(rng, 1.0, Vector3d::UnitX());
  const int shell = body.add_paint(coat), legs = body.add_paint(shade(coat, body.between(0.6, 1.2))),
            dark = body.add_paint(shade(coat, 0.35));
  const int root = body.joint("shell", maybe_ground_root(body, 0.15), {0, 0, height}, {0, -depth, height}, depth);
  body.ellipsoid(root, {0, 0, height}, {width, depth, 0.5 * depth}, shell);
  for (int k = -3; k <= 3; ++k) {
    if (k != 0)
      body.cone(root, {0.24 * k * width, -0.75 * depth, height},
                {0.28 * k * width, -1.02 * depth + 0.03 * k * k * depth, height + 0.02}, 0.06, 0.03, shell);
  }
  std::vector<int> tips;
  const int eyes = body.add_paint(plain(Vector3d::Constant(0.01)));
  for (int side : {1, -1}) {
    const Vector3d base(side * 0.22 * width, -0.75 * depth, height + 0.25 * depth),
        top = base + Vector3d(side * 0.03, -0.06, body.between(0.12, 0.2));
    const int stalk = body.joint("eye_stalk_" + side_name(side), root, base, top, 0.035);
    body.cone(stalk, base, top, 0.035, 0.03, legs);
    body.eye(stalk, top, 0.055, {0, -1, 0}, eyes);
    body.swing(stalk, Vector3d::UnitX(), 0.2, side * 0.8);
    const double s = side, claw = body.between(0.16, 0.25) * (side > 0 ? 1.0 : body.between(0.7, 1.0));
    const Vector3d shoulder(s * 0.7 * width, -0.6 * depth, height), elbow = shoulder + Vector3d(s * 0.25, -0.14, 0.06),
                                                                    wrist = elbow + Vector3d(-s * 0.04, -0.24, 0.0);
    const std::string name = "claw_" + side_name(side);
    const auto arm =
        body.limb(root, {name + "_upper", name + "_lower"}, {shoulder, elbow, wrist}, {0.07, 0.08, 0.06}, legs);
    const Vector3d ahead = Vector3d(-s * 0.4, -1, 0).normalized(), across(s, -0.4, 0);
    const Vector3d palm = wrist + 0.7 * claw * ahead;
    const int hand = body.joint(name + "_palm", arm[1], wrist, palm + claw * ahead, 0.7 * claw);
    body.ellipsoid(hand, palm, {0.62 * claw, 0.42 * claw, 0.9 * claw}, shell, frame_along(ahead, across));
    const Vector3d root_a = palm + 0.5 * claw * ahead + 0.35 * claw * across,
                   root_b = palm + 0.5 * claw * ahead - 0.3 * claw * across;
    body.cone(hand, root_a, root_a + 0.6 * claw * ahead + 0.12 * claw * across, 0.25 * claw, 0.18 * claw, shell);
    body.cone(hand, root_a + 0.6 * claw * ahead + 0.12 * claw * across,
              palm + 1.75 * claw * ahead + 0.2 * claw * across, 0.18 * claw, 0.08 * claw, dark);
    const int thumb = body.joint(name + "_finger", hand, root_b, root_b + 1.1 * claw * ahead, 0.2 * claw);
    body.cone(thumb, root_b, root_b + 0.55 * claw * ahead - 0.2 * claw * across, 0.2 * claw, 0.16 * claw, legs);
    body.cone(thumb, root_b + 0.55 * claw * ahead - 0.2 * claw * across,
              root_b + 1.2 * claw * ahead - 0.02 * claw * across, 0.16 * claw, 0.08 * claw, dark);
    body.swing(thumb, Vector3d::UnitZ(), 0.25 * s, 0.0);
    body.swing(arm[0], Vector3d::UnitZ(), 0.12 * s, 0.5);
    tips.push_back(thumb);
  }
  Legs l{body.count(3, 4),
         body.count(2, 4),
         body.between(0.36, 0.5),
         body.between(0.1, 0.2),
         body.between(0.045, 0.065),
         body.between(0.1, 0.4),
         -body.between(0.5, 0.9),
         1.1 * depth,
         0.95 * width,
         height - 0.02};
  add_legs(body, root, l, legs, tips);
  add_rig_habits(body, {}, tips);
}

void build_snake(Body& body) {
  Rng& rng = body.rng;
  const int segments = body.count(7, 28);
  const double radius = body.between(0.045, 0.085), length = 2.0;
  const double waves = body.between(0.8, 2.2), amplitude = body.between(0.1, 0.28);
  const double rearing = rng.chance(0.4) ? body.between(0.2, 0.5) : 0.0;
  const bool coiled = rng.chance(0.3);
  body.smoothness = 0.5;
  body.softness = body.between(0.8, 2.2);
  body.weight_smoothing = 4;
  Paint scales = random_coat(rng, 0.35 * length, Vector3d::UnitY());
  const int skin = body.add_paint(scales);

  // The path from the tail's tip to the neck, t in [0, 1].
  const auto path = [&](double t) {
    if (coiled) {
      // A flat spiral: turns keep a distance of several radii.
      const double turns = 1.6, angle = 2.0 * kPi * turns * t;
      const double r = 0.22 + 4.0 * radius * turns * (1.0 - t);
      const double rise = std::max(0.0, t - 0.75) / 0.25;
      return Vector3d(r * std::cos(angle), r * std::sin(angle), radius * (1.0 + 5.0 * rise * rise));
    }
    Vector3d p(amplitude * std::sin(2.0 * kPi * waves * t), 0.7 * length * (0.5 - t), radius);
    const double lift = std::max(0.0, t - 0.7) / 0.3;
    p.z() += (rearing + 0.5 * radius) * lift * lift * (3.0 - 2.0 * lift);
    if (rearing > 0.0) p.y() += 0.2 * lift * lift;
    return p;
  };
  std::vector<Vector3d> points;
  for (int i = 0; i <= segments; ++i) points.push_back(path(static_cast<double>(i) / segments));
  const double bulge = body.between(1.0, 1.4);
  const auto thickness = [&](double t) {
    return radius * std::min(1.0, 0.25 + 2.2 * t) * (1.0 + (bulge - 1.0) * std::sin(kPi * t));
  };
  // Flesh follows the path more finely than the bones do.
  const auto wrap = [&](int joint, int from, int to) {
    const int parts = segments < 14 ? 4 : 2;
    for (int k = 0; k < parts; ++k) {
      const double a = (from + (to - from) * static_cast<double>(k) / parts) / segments;
      const double b = (from + (to - from) * (k + 1.0) / parts) / segments;
      body.cone(joint, path(a), path(b), thickness(a), thickness(b), skin);
    }
  };
  // Rigs of snakes start in the middle or at the tail; the head's chain then runs forward from there.
  const int middle = rng.chance(0.5) ? segments / 2 : 0;
  const int root = body.joint("root", -1, points[middle], points[middle] + Vector3d(0, 0, 0.1), thickness(0.5));
  std::vector<int> bones;
  const auto grow = [&](const std::string& name, int end) {
    const int step = end > middle ? 1 : -1;
    const auto names = numbered(name, std::abs(end - middle));
    int parent = root;
    for (int i = middle; i != end; i += step) {
      parent = body.joint(names[std::abs(i - middle)], parent, points[i], points[i + step],
                          thickness(static_cast<double>(i) / segments));
      wrap(parent, i, i + step);
      bones.push_back(parent);
    }
    return parent;
  };
  const int neck = grow("spine", segments), tail = grow("tail", 0);
  body.swing_chain(bones, Vector3d::UnitZ(), 1.1 / segments, 1.2);
  const double head = radius * body.between(1.3, 1.9);
  const Vector3d nape = points[segments];
  Vector3d ahead = nape - points[segments - 1];
  ahead.z() = std::min(ahead.z(), 0.0);
  ahead.normalize();
  const Vector3d across = Vector3d::UnitZ().cross(ahead).normalized();
  const int head_joint = body.joint("head", neck, nape, nape + 3.0 * head * ahead, head);
  Eigen::Matrix3d frame;
  frame << across, ahead, across.cross(ahead);
  const bool hood = rearing > 0.0 && rng.chance(0.5);
  body.ellipsoid(head_joint, nape + 1.0 * head * ahead, {1.05 * head, 1.5 * head, 0.7 * head}, skin, frame);
  body.ellipsoid(head_joint, nape + 2.0 * head * ahead, {0.7 * head, 1.1 * head, 0.5 * head}, skin, frame);
  if (hood) {
    const Vector3d along = (points[segments] - points[segments - 1]).normalized();
    body.ellipsoid(neck, nape - 0.5 * (points[segments] - points[segments - 1]),
                   {2.6 * radius, 0.6 * radius, 4.0 * radius}, skin, frame_along(along, across));
  }
  const int paint = body.add_paint(eye_paint(rng));
  for (int side : {1, -1}) {
    body.eye(head_joint, nape + 1.5 * head * ahead + side * 0.72 * head * across + 0.4 * head * Vector3d::UnitZ(),
             0.26 * head, ahead + side * 0.9 * across, paint);
  }
  const int jaw = body.joint("jaw", head_joint, nape + 0.6 * head * ahead - Vector3d(0, 0, 0.35 * head),
                             nape + 2.8 * head * ahead - Vector3d(0, 0, 0.4 * head), 0.5 * head);
  body.ellipsoid(jaw, nape + 1.7 * head * ahead - Vector3d(0, 0, 0.42 * head), {0.65 * head, 1.25 * head, 0.32 * head},
                 skin, frame);
  body.swing(jaw, across, 0.12, 0.0);
  body.swing(head_joint, Vector3d::UnitZ(), 0.2, 0.5);
  add_rig_habits(body, {}, {tail, jaw});
}

void build_octopus(Body& body) {
  Rng& rng = body.rng;
  body.smoothness = 0.9;
  body.softness = body.between(0.8, 2.0);
  body.weight_smoothing = 4;
  const Paint coat = random_coat(rng, 1.0, Vector3d::UnitZ());
  const int skin = body.add_paint(coat);
  const double size = body.between(0.2, 0.32), tall = body.between(1.0, 1.7), radius = body.between(0.055, 0.08);
  const int arms = body.count(5, 8), segments = body.count(3, std::min(7, 50 / arms));
  const double z = 0.3;
  const int root = body.joint("body", -1, {0, 0, z}, {0, 0, z + size}, size);
  const Vector3d lean(0, body.between(0.0, 0.35), 0);
  const int mantle = body.joint("mantle", root, {0, 0, z + 0.6 * size},
                                Vector3d(0, 0, z + size * (0.6 + 1.2 * tall)) + lean, 0.9 * size);
  body.ellipsoid(root, {0, 0, z + 0.2 * size}, {0.85 * size, 0.85 * size, 0.7 * size}, skin);
  body.ellipsoid(mantle, Vector3d(0, 0, z + size * (0.5 + 0.7 * tall)) + 0.6 * lean, {size, size, 0.85 * size * tall},
                 skin, frame_along(Vector3d(0, 0, 1) + lean));
  body.swing(mantle, Vector3d::UnitX(), 0.12, 0.0);
  add_eyes(body, root, {0, -0.75 * size, z + 0.55 * size}, 0.45 * size, 0.24 * size, {0, -1, 0.1});
  const double reach = body.between(0.7, 1.0), curl = body.between(0.0, 0.25);
  std::vector<int> tips;
  for (int a = 0; a < arms; ++a) {
    const double turn = 2.0 * kPi * (a + 0.5) / arms + 0.1 * rng.normal();
    const Vector3d out(std::cos(turn), std::sin(turn), 0), around(-std::sin(turn), std::cos(turn), 0);
    std::vector<Vector3d> points;
    for (int i = 0; i <= segments; ++i) {
      const double t = static_cast<double>(i) / segments;
      const double drop = z * (1.0 - t) * (1.0 - t) + 0.03 + curl * t * t * t;
      points.push_back(out * (0.45 * size + reach * t) + 0.14 * std::sin(4.0 * t + a) * t * around +
                       Vector3d(0, 0, drop));
    }
    const auto arm = body.limb(root, numbered("arm_" + std::string(1, static_cast<char>('a' + a)), segments), points,
                               taper(radius * 1.3, 0.35 * radius, segments), skin);
    for (std::size_t i = 0; i < arm.size(); ++i) {
      body.swing(arm[i], out.cross(Vector3d::UnitZ()), 0.5 / segments, a * 1.3 - 0.9 * static_cast<double>(i));
      body.bend(arm[i], Vector3d::UnitZ(), 0.1 * rng.normal());
    }
    tips.push_back(arm.back());
  }
  add_rig_habits(body, {}, tips);
}

void build_hand(Body& body) {
  Rng& rng = body.rng;
  body.smoothness = 0.8;
  body.softness = body.between(0.4, 1.0);
  const bool monster = rng.chance(0.35);
  Paint skin_paint =
      monster ? random_coat(rng, 0.8, Vector3d::UnitZ())
              : Paint(plain(color_of(body.between(0.04, 0.09), body.between(0.25, 0.6), body.between(0.35, 0.95))));
  const int skin = body.add_paint(skin_paint);
  const int nail = body.add_paint(plain(monster ? color_of(0.1, 0.3, 0.25) : Vector3d(0.9, 0.65, 0.6)));
  const int sleeve = body.add_paint(plain(color_of(rng.uniform(), 0.6, body.between(0.2, 0.9))));
  const double width = body.between(0.19, 0.26), r = width * body.between(0.2, 0.25);
  const int forearm = body.joint("forearm", -1, {0, 0, 0}, {0, 0, 0.35}, 0.6 * width);
  body.cone(forearm, {0, 0, 0.03}, {0, 0, 0.38}, 0.62 * width, 0.5 * width, skin);
  if (rng.chance(0.5))
    body.cylinder(forearm, {0, 0, -0.05}, {0, 0, 0.18}, 0.85 * width, 0.8 * width, 0.03, sleeve).blend = 0.0;
  const double palm = body.between(0.32, 0.42);
  const Vector3d wrist(0, 0, 0.38);
  const int hand = body.joint("wrist", forearm, wrist, {0, 0, 0.38 + palm}, 0.55 * width);
  body.box(hand, wrist + Vector3d(0, 0, 0.5 * palm), {0.9 * width, 0.42 * width, 0.6 * palm}, 0.4 * width, skin).blend =
      0.3 * width;
  body.cone(hand, wrist + Vector3d(0.5 * width, -0.1 * width, 0.1),
            wrist + Vector3d(0.75 * width, -0.15 * width, 0.45 * palm), 0.4 * width, 0.35 * width, skin);
  const int fingers = monster ? body.count(2, 4) : 4;
  static const char* const kNames[] = {"index", "middle", "ring", "pinky"};
  const double fist = body.between(0.0, 1.0), spread = body.between(0.05, 0.22);
  const bool metacarpals = rng.chance(0.4);
  std::vector<int> tips, limbs{forearm};
  for (int f = 0; f < fingers; ++f) {
    const double at = fingers == 1 ? 0.0 : 1.0 - 2.0 * f / (fingers - 1.0);
    const double length = body.between(0.4, 0.46) * (1.0 - 0.22 * (at + 0.2) * (at + 0.2) - (f == 3 ? 0.15 : 0.0));
    const Vector3d knuckle = wrist + Vector3d(at * 0.74 * width, 0, palm * (1.0 - 0.06 * at * at));
    const Vector3d up = Vector3d(spread * at, 0, 1).normalized();
    int parent = hand;
    if (metacarpals) {
      const Vector3d start = wrist + Vector3d(0.35 * at * width, 0, 0.15 * palm);
      parent = body.joint(std::string(kNames[f]) + "_metacarpal", hand, start, knuckle, 0.35 * width);
      body.cone(parent, start, knuckle, r, r, skin);
    }
    const double radius = r * (f == 3 ? 0.85 : 1.0);
    const std::vector<Vector3d> points{knuckle, knuckle + 0.45 * length * up, knuckle + 0.75 * length * up,
                                       knuckle + length * up};
    const auto chain = body.limb(parent, numbered(kNames[f], 3), points, taper(radius, 0.75 * radius, 3), skin);
    const double curl = fist * body.between(0.1, 0.9);
    for (int j : chain) {
      body.bend(j, Vector3d::UnitX(), curl);
      body.swing(j, Vector3d::UnitX(), 0.15, -0.5 * f);
      for (Primitive& p : body.primitives) {
        if (p.joint == j) p.blend = 0.35 * radius;
      }
    }
    const Vector3d tip = points[3] + 0.2 * radius * up;
    if (monster) {
      body.cone(chain.back(), tip, tip + Vector3d(0, -0.05, 0.14), 0.6 * radius, 0.25 * radius, nail).blend =
          0.1 * radius;
    } else {
      body.ellipsoid(chain.back(), tip + Vector3d(0, 0.55 * radius, 0), {0.55 * radius, 0.3 * radius, 0.7 * radius},
                     nail)
          .blend = 0.0;
    }
    tips.push_back(chain.back());
  }
  const Vector3d base = wrist + Vector3d(0.6 * width, -0.1 * width, 0.25 * palm);
  const Vector3d out = Vector3d(0.75, -0.25, body.between(0.5, 1.0)).normalized();
  const double length = body.between(0.36, 0.44);
  const auto thumb = body.limb(hand, numbered("thumb", 3),
                               {base, base + 0.4 * length * out, base + 0.72 * length * out, base + length * out},
                               taper(1.35 * r, 0.85 * r, 3), skin);
  for (int j : thumb) {
    body.bend(j, Vector3d(0, 0.3, -1).normalized(), 0.25 * fist);
    body.swing(j, Vector3d::UnitY(), 0.12, 0.4);
  }
  tips.push_back(thumb.back());
  body.swing(hand, Vector3d::UnitX(), 0.15, 0.0);
  add_rig_habits(body, limbs, tips);
}

}  // namespace anigen::creatures
