#include <algorithm>

#include "anigen/prepare/creatures/families/families.h"
#include "anigen/prepare/creatures/families/parts.h"

namespace anigen::prepare {
namespace {

using Eigen::Vector3d;

struct Proportions {
  double leg, torso, neck, head, arm, shoulder, hip, girth, limb;
};

struct Wardrobe {
  int skin, top, bottom, shoe, hair;
};

Wardrobe dress(Body& body, bool clothed, double height) {
  Rng& rng = body.rng;
  if (!clothed) {
    Paint coat = random_coat(rng, height, Vector3d::UnitZ());
    coat.down = -Vector3d::UnitY();
    const int skin = body.add_paint(coat);
    const int dark = body.add_paint(shade(coat, 0.4));
    return {skin, skin, rng.chance(0.3) ? dark : skin, dark, dark};
  }
  Paint top = random_coat(rng, height, Vector3d::UnitZ());
  top.down.setZero();
  Paint bottom = plain(color_of(rng.uniform(), rng.uniform(0.1, 0.7), rng.uniform(0.15, 0.6)));
  const double tone = rng.uniform(0.35, 0.95);
  return {body.add_paint(plain(color_of(rng.uniform(0.04, 0.09), 0.75 - 0.45 * tone, tone))), body.add_paint(top),
          body.add_paint(bottom), body.add_paint(plain(color_of(rng.uniform(), 0.4, rng.uniform(0.05, 0.5)))),
          body.add_paint(plain(color_of(rng.uniform(0.0, 0.15), rng.uniform(0.2, 0.8), rng.uniform(0.05, 0.9))))};
}

/// Spine, neck and head. @return {chest, head}
std::pair<int, int> add_trunk(Body& body, int hips, const Proportions& p, const Wardrobe& w, bool clothed) {
  const int segments = body.count(2, 4);
  const double low = p.leg + 0.04, top = low + p.torso;
  const auto points = curve({0, 0, low + 0.06}, {0, 0.03, low + 0.5 * p.torso}, {0, 0, top}, segments);
  int chest = hips;
  const auto names = numbered("spine", segments);
  for (int i = 0; i < segments; ++i) {
    const double t = (i + 0.5) / segments;
    const double width = p.hip * (1.15 - t) + p.shoulder * 0.78 * t;
    chest = body.joint(names[i], chest, points[i], points[i + 1], 0.75 * width);
    body.ellipsoid(chest, 0.5 * (points[i] + points[i + 1]),
                   {width, p.girth * (0.9 + 0.25 * t), 0.75 * p.torso / segments + 0.05}, w.top);
    body.swing(chest, Vector3d::UnitX(), 0.03, -0.4 * i);
  }
  if (body.rng.chance(0.35)) {
    body.ellipsoid(body.joints[chest].parent, {0, -0.35 * p.girth, low + 0.35 * p.torso},
                   {p.hip, p.girth * body.between(0.8, 1.2), 0.33 * p.torso}, w.top);
  }
  const Vector3d base(0, 0, top - 0.02), chin = base + Vector3d(0, -0.02, p.neck);
  const int neck = body.joint("neck", chest, base, chin, 0.5 * p.head);
  body.cone(neck, base - Vector3d(0, 0, 0.04), chin, 0.42 * p.head, 0.4 * p.head, w.skin);
  const Vector3d center = chin + Vector3d(0, -0.1 * p.head, 0.8 * p.head);
  const int head = body.joint("head", neck, chin, center + Vector3d(0, 0, p.head), 0.6 * p.head);
  const Vector3d skull(p.head * body.between(0.8, 1.0), p.head * body.between(0.85, 1.0),
                       p.head * body.between(0.95, 1.15));
  body.ellipsoid(head, center, skull, w.skin);
  body.swing(neck, Vector3d::UnitZ(), 0.1, 0.5);
  body.swing(head, Vector3d::UnitX(), 0.07, 1.0);
  add_eyes(body, head, center + Vector3d(0, -0.82 * skull.y(), 0.1 * p.head), 0.38 * skull.x(), 0.19 * p.head,
           {0, -1, 0});
  if (clothed || body.rng.chance(0.5)) {
    body.ball(head, center + Vector3d(0, -1.0 * skull.y(), -0.2 * p.head), 0.14 * p.head, w.skin);
  } else {
    body.ellipsoid(head, center + Vector3d(0, -0.8 * skull.y(), -0.35 * p.head),
                   {0.45 * p.head, 0.6 * p.head, 0.35 * p.head}, w.skin);
  }
  const double extra = body.rng.uniform();
  if (clothed) {
    body.ellipsoid(head, center + Vector3d(0, 0.16 * p.head, 0.22 * p.head),
                   skull.cwiseProduct(Vector3d(1.06, 1.0, 0.98)), w.hair)
        .blend *= 0.2;
  } else if (extra < 0.6) {
    add_ears(body, head, center + Vector3d(0, 0, 0.7 * p.head), 0.6 * skull.x(), {0.5, 0.1, 0.9},
             p.head * body.between(0.5, 1.4), w.skin);
  }
  if (!clothed && extra > 0.45) {
    add_horns(body, head, center + Vector3d(0, -0.2 * p.head, 0.75 * p.head), 0.4 * skull.x(),
              p.head * body.between(0.5, 1.2), 0.2 * p.head);
  }
  return {chest, head};
}

}  // namespace

void build_biped(Body& body) {
  const bool cartoon = body.rng.chance(0.5), clothed = body.rng.chance(0.55);
  Proportions p{};
  p.leg = cartoon ? body.between(0.35, 0.65) : body.between(0.75, 0.95);
  p.torso = cartoon ? body.between(0.4, 0.6) : body.between(0.5, 0.62);
  p.head = cartoon ? body.between(0.19, 0.3) : body.between(0.12, 0.16);
  p.neck = p.head * body.between(0.3, 0.7);
  p.arm = (p.leg + p.torso) * body.between(0.38, 0.52);
  p.shoulder = body.between(0.2, 0.3);
  p.hip = p.shoulder * body.between(0.55, 0.95);
  p.girth = p.shoulder * body.between(0.45, 0.75);
  p.limb = body.between(0.055, 0.085) * (cartoon ? 1.1 : 1.0);
  const double height = p.leg + p.torso + p.neck + 2 * p.head;
  body.smoothness = 0.7;
  body.softness = body.between(0.35, 1.0);
  body.resolution = 1.15;
  const Wardrobe w = dress(body, clothed, height);

  const int ground = maybe_ground_root(body, 0.2);
  const Vector3d pelvis(0, 0, p.leg + 0.03);
  const int hips = body.joint("hips", ground, pelvis, pelvis + Vector3d(0, 0, 0.1), p.hip);
  body.ellipsoid(hips, pelvis, {p.hip * 1.05, p.girth, 0.13}, w.bottom);
  const auto [chest, head] = add_trunk(body, hips, p, w, clothed);

  static constexpr int kFingers[] = {0, 0, 2, 3, 4, 5, 5};
  const int fingers = kFingers[body.rng.index(7)];
  const int segments = fingers > 0 ? body.count(fingers > 3 ? 2 : 1, 3) : 0;
  if (fingers > 0) body.resolution = 1.7;
  const double shoulder_height = p.leg + 0.04 + p.torso - 0.07;
  const double pose = body.rng.uniform();  // T-pose, A-pose, or relaxed
  const double drop = pose < 0.35 ? 0.0 : pose < 0.65 ? body.between(0.5, 0.9) : body.between(0.2, 1.25);
  const double elbow_bend = pose < 0.65 ? 0.0 : body.between(0.1, 0.9);
  std::vector<int> limbs, tips{head};
  for (int side : {1, -1}) {
    const std::string name = side_name(side);
    const double s = side, r = p.limb;
    const Vector3d neck_base(s * 0.03, 0, shoulder_height + 0.02), shoulder(s * p.shoulder, 0, shoulder_height);
    const int clavicle = body.joint("shoulder_" + name, chest, neck_base, shoulder, 1.4 * r);
    body.cone(clavicle, neck_base, shoulder, 1.1 * r, 1.15 * r, w.top);
    const Vector3d elbow = shoulder + Vector3d(s * 0.5 * p.arm, 0.01, 0),
                   wrist = elbow + Vector3d(s * 0.5 * p.arm, -0.01, 0);
    const auto arm = body.limb(clavicle, {"arm_" + name + "_upper", "arm_" + name + "_lower"}, {shoulder, elbow, wrist},
                               {1.1 * r, 0.85 * r, 0.65 * r}, w.skin);
    if (clothed) body.cone(arm[0], shoulder, 0.4 * shoulder + 0.6 * elbow, 1.3 * r, 1.15 * r, w.top);
    const int hand = add_hand(body, arm[1], "hand_" + name + "_", wrist - Vector3d(s * 0.02, 0, 0), {s, 0, 0},
                              {0, -1, 0}, (fingers > 0 ? 3.6 : 3.0) * r, fingers, segments, w.skin);
    body.joints[hand].name = "hand_" + name;
    body.bend(arm[0], Vector3d::UnitY(), s * drop);
    body.bend(arm[1], Vector3d(0, 0.4, -1), s * elbow_bend);
    body.swing(arm[0], Vector3d::UnitY(), 0.1, side > 0 ? 0.0 : 0.6);
    body.swing(arm[1], Vector3d::UnitZ(), 0.15, side > 0 ? 0.5 : 1.1);
    limbs.insert(limbs.end(), {arm[0], arm[1]});
    tips.push_back(hand);

    const double stance = std::max(0.62 * p.hip, 1.5 * r), thigh = 1.35 * r;
    const Vector3d hip(s * stance, 0, p.leg), knee(s * stance * 1.1, -0.015, 0.52 * p.leg),
        ankle(s * stance * 1.15, 0.015, 0.08);
    const Vector3d ball = ankle + Vector3d(0, -0.13, -0.045), toe = ball + Vector3d(0, -0.09, 0);
    const auto leg = body.limb(hips, {"leg_" + name + "_upper", "leg_" + name + "_lower"}, {hip, knee, ankle},
                               {thigh, 1.05 * r, 0.75 * r}, w.bottom);
    const auto foot =
        body.limb(leg[1], {"foot_" + name, "toe_" + name}, {ankle, ball, toe}, {0.8 * r, 0.75 * r, 0.6 * r}, w.shoe);
    body.ellipsoid(foot[0], ankle + Vector3d(0, 0.03, -0.03), {0.9 * r, 1.1 * r, 0.8 * r}, w.shoe);
    if (pose > 0.65) {
      const double step = body.rng.normal() * 0.22;
      body.bend(leg[0], Vector3d::UnitX(), step);
      body.bend(leg[1], Vector3d::UnitX(), body.between(0.0, 0.4));
    }
    body.swing(leg[0], Vector3d::UnitX(), 0.03, side > 0 ? 0.0 : 3.1);
    limbs.push_back(leg[0]);
    tips.push_back(foot[1]);
  }
  if (!clothed && body.rng.chance(0.4) && body.joints.size() < 52) {
    const auto tail = add_tail(body, hips,
                               {pelvis + Vector3d(0, 0.7 * p.girth, 0),
                                {0, 1, body.between(-0.2, 0.5)},
                                body.between(0.3, 0.7),
                                0.06,
                                0.03,
                                body.count(2, 5),
                                body.between(0.0, 0.4)},
                               w.skin);
    tips.push_back(tail.back());
  }
  if (pose > 0.65) body.bend_randomly(head, 0.15);
  add_rig_habits(body, limbs, tips);
}

}  // namespace anigen::prepare
