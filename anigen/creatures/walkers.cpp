#include <algorithm>

#include "anigen/creatures/parts.h"

namespace anigen::creatures {

using Eigen::Vector3d;

namespace {

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

void build_quadruped(Body& body) {
  Rng& rng = body.rng;
  // From sturdy (elephant, pig) to slender (deer, giraffe).
  const double slender = rng.uniform();
  const double length = body.between(0.7, 1.2), girth = (0.3 - 0.13 * slender) * body.between(0.85, 1.15);
  const double leg = (0.35 + 0.5 * slender) * body.between(0.8, 1.2),
               r = (0.1 - 0.05 * slender) * body.between(0.9, 1.15);
  const double neck_length = rng.chance(0.2) ? body.between(0.5, 0.9) : body.between(0.15, 0.45);
  const double head = girth * body.between(0.55, 0.85);
  body.smoothness = 0.8;
  body.softness = body.between(0.3, 0.8);
  const Paint coat = random_coat(rng, length, Vector3d::UnitY());
  const int skin = body.add_paint(coat), dark = body.add_paint(shade(coat, rng.chance(0.5) ? 0.3 : 0.6));

  const int ground = maybe_ground_root(body, 0.2);
  const double z = leg + 0.6 * girth;
  const Vector3d rump(0, 0.45 * length, z), withers(0, -0.45 * length, z + body.between(-0.05, 0.1));
  const int hips = body.joint("hips", ground, rump, rump - Vector3d(0, 0.1, 0), girth);
  body.ellipsoid(hips, rump, {0.82 * girth, girth, 0.95 * girth}, skin);
  const int segments = body.count(2, 5);
  const auto points = curve(rump - Vector3d(0, 0.05, 0), {0, 0, z + body.between(-0.08, 0.12)}, withers, segments);
  const auto spine = body.limb(hips, numbered("spine", segments), points,
                               taper(0.82 * girth, 0.85 * girth, segments, body.between(0.9, 1.2)), skin);
  body.swing_chain(spine, Vector3d::UnitX(), 0.02, 0.5);
  const int chest = spine.back();
  body.ellipsoid(chest, withers + Vector3d(0, 0.02, -0.1 * girth), {0.8 * girth, 0.9 * girth, 1.08 * girth}, skin);

  const int neck_count = neck_length > 0.45 ? body.count(2, 5) : body.count(1, 2);
  const double rise = body.between(0.3, 1.1);
  const Vector3d collar = withers + Vector3d(0, -0.5 * girth, 0.35 * girth);
  const Vector3d nape = collar + neck_length * Vector3d(0, -1, rise + 0.2).normalized();
  const auto neck = body.limb(chest, neck_count == 1 ? std::vector<std::string>{"neck"} : numbered("neck", neck_count),
                              curve(collar, 0.5 * (collar + nape) + Vector3d(0, 0.05, -0.03), nape, neck_count),
                              taper(0.62 * girth, 0.62 * head, neck_count), skin);
  for (int j : neck) {
    body.bend(j, Vector3d::UnitX(), 0.12 * rng.normal());
    body.swing(j, Vector3d::UnitX(), 0.1 / neck_count, 0.3);
  }
  const double snout = head * body.between(0.7, 1.7);
  const Vector3d skull = nape + Vector3d(0, -0.35 * head, 0.15 * head);
  const Vector3d nose = skull + Vector3d(0, -0.4 * head - snout, -0.45 * head);
  const int skull_joint = body.joint("head", neck.back(), nape, nose, 0.8 * head);
  body.ellipsoid(skull_joint, skull, {0.72 * head, 0.9 * head, 0.78 * head}, skin);
  const double muzzle = head * body.between(0.3, 0.5);
  body.cone(skull_joint, skull - Vector3d(0, 0.2 * head, 0.2 * head), nose, 0.6 * head, muzzle, skin);
  body.ellipsoid(skull_joint, nose + Vector3d(0, -0.75 * muzzle, 0.35 * muzzle),
                 {0.45 * muzzle, 0.35 * muzzle, 0.35 * muzzle}, dark);
  if (rng.chance(0.4)) {
    const Vector3d hinge = skull + Vector3d(0, -0.2 * head, -0.4 * head),
                   chin = nose + Vector3d(0, 0.1 * head, -0.6 * muzzle);
    const int jaw = body.joint("jaw", skull_joint, hinge, chin, 0.5 * muzzle);
    body.cone(jaw, hinge, chin, 0.6 * muzzle, 0.55 * muzzle, skin);
    body.swing(jaw, Vector3d::UnitX(), 0.06, 0.0);
  }
  add_eyes(body, skull_joint, skull + Vector3d(0, -0.55 * head, 0.3 * head), 0.5 * head, 0.2 * head, {0, -0.3, 0.05});
  add_ears(body, skull_joint, skull + Vector3d(0, 0.2 * head, 0.5 * head), 0.45 * head,
           {body.between(0.2, 1.0), 0.15, body.between(0.4, 1.0)}, head * body.between(0.6, 1.5), skin);
  if (rng.chance(0.35)) {
    add_horns(body, skull_joint, skull + Vector3d(0, 0, 0.6 * head), 0.3 * head, head * body.between(0.6, 1.8),
              0.18 * head);
  }
  body.swing(skull_joint, Vector3d::UnitZ(), 0.12, 0.8);

  const bool posed = rng.chance(0.5);
  const bool paws = rng.chance(0.5);
  std::vector<int> limbs, tips;
  for (int front : {1, 0}) {
    for (int side : {1, -1}) {
      const double s = side, y = front ? withers.y() + 0.05 : rump.y();
      const double x = std::max(0.5 * girth, 1.25 * r), knee_back = front ? 0.03 : -0.06;
      const std::string prefix = std::string("leg_") + (front ? "front_" : "back_") + side_name(side) + "_";
      const Vector3d hip(s * x, y, z - 0.15 * girth), knee(s * x * 1.08, y + knee_back, 0.55 * leg);
      const Vector3d hock(s * x * 1.08, y + (front ? -0.01 : 0.05), 0.2 * leg), sole(s * x * 1.08, y - 0.015, 0.85 * r);
      std::vector<std::string> names{"upper", "knee", "ankle"};
      std::vector<Vector3d> at{hip, knee, hock, sole};
      std::vector<double> radii{(front ? 1.7 : 2.0) * r, 1.15 * r, 0.85 * r, 0.8 * r};
      int parent = front ? chest : hips;
      if (front && side != 0 && body.joints.size() < 40 && slender > 0.5) {
        const Vector3d blade(s * 0.5 * x, y + 0.08, z + 0.3 * girth);
        parent = body.joint("shoulder_" + side_name(side), chest, blade, hip, 1.5 * r);
      }
      const auto leg_joints = add_leg(body, parent, prefix, names, at, radii, skin);
      if (paws) {
        body.ellipsoid(leg_joints.back(), sole + Vector3d(0, -0.5 * r, 0), {1.1 * r, 1.5 * r, 0.8 * r}, dark);
      } else {
        body.cylinder(leg_joints.back(), sole + Vector3d(0, -0.2 * r, -0.8 * r), sole + Vector3d(0, 0, 0.5 * r),
                      1.25 * r, 0.9 * r, 0.2 * r, dark);
      }
      if (posed) {
        const double step = 0.3 * rng.normal();
        body.bend(leg_joints[0], Vector3d::UnitX(), step);
        body.bend(leg_joints[1], Vector3d::UnitX(), front ? -0.5 * std::abs(step) : 0.4 * std::abs(step));
      }
      body.swing(leg_joints[0], Vector3d::UnitX(), 0.04, (front ? 0.0 : 1.5) + (side > 0 ? 0.0 : 3.14));
      limbs.push_back(leg_joints[0]);
      tips.push_back(leg_joints.back());
    }
  }
  const double tail_length = body.between(0.2, 0.8);
  const auto tail = add_tail(body, hips,
                             {rump + Vector3d(0, 0.85 * girth, 0.3 * girth),
                              {0, 1, body.between(-0.5, 0.6)},
                              tail_length,
                              0.25 * girth,
                              0.1 * girth,
                              body.count(2, 6),
                              body.between(0.0, 0.8)},
                             skin);
  if (rng.chance(0.3)) body.ball(tail.back(), body.joints[tail.back()].tail, 0.2 * girth, dark);
  tips.push_back(tail.back());
  add_rig_habits(body, limbs, tips);
}

void build_dragon(Body& body) {
  Rng& rng = body.rng;
  const bool wyvern = rng.chance(0.3);  // wings for forelegs
  const double girth = body.between(0.15, 0.24), length = body.between(0.5, 0.8), leg = body.between(0.3, 0.5);
  const double r = 0.3 * girth, head = girth * body.between(0.55, 0.8);
  body.smoothness = 0.7;
  body.softness = body.between(0.3, 0.8);
  body.resolution = 1.4;
  const Paint coat = random_coat(rng, length, Vector3d::UnitY());
  const int skin = body.add_paint(coat), horn = body.add_paint(shade(coat, 0.3));
  Paint membrane = shade(coat, body.between(0.5, 1.2));
  if (rng.chance(0.6)) membrane.base = membrane.under = coat.accent;
  const int wing_skin = body.add_paint(membrane);

  const double z = leg + 0.5 * girth;
  const Vector3d rump(0, 0.4 * length, z), withers(0, -0.4 * length, z + body.between(0.0, 0.2));
  const int hips = body.joint("hips", -1, rump, rump - Vector3d(0, 0.1, 0), girth);
  body.ellipsoid(hips, rump, {0.8 * girth, girth, 0.85 * girth}, skin);
  const int segments = body.count(2, 3);
  const auto points = curve(rump, {0, 0, z}, withers, segments);
  const auto spine =
      body.limb(hips, numbered("spine", segments), points, taper(0.8 * girth, 0.85 * girth, segments), skin);
  const int chest = spine.back();
  body.ellipsoid(chest, withers, {0.85 * girth, girth, 1.0 * girth}, skin);
  for (int j : spine) body.swing(j, Vector3d::UnitX(), 0.03, 0.0);

  const int neck_count = body.count(2, 5);
  const double neck_length = body.between(0.35, 0.75);
  const Vector3d collar = withers + Vector3d(0, -0.4 * girth, 0.4 * girth);
  const Vector3d nape = collar + neck_length * Vector3d(0, -0.6, body.between(0.4, 1.1)).normalized();
  const auto neck_points = curve(collar, collar + Vector3d(0, -0.65 * neck_length, 0.05), nape, neck_count);
  const auto neck =
      body.limb(chest, numbered("neck", neck_count), neck_points, taper(0.6 * girth, 0.55 * head, neck_count), skin);
  for (std::size_t i = 0; i < neck.size(); ++i) {
    body.bend(neck[i], Vector3d::UnitZ(), 0.12 * rng.normal());
    body.swing(neck[i], Vector3d::UnitX(), 0.2 / neck_count, -0.6 * static_cast<double>(i));
  }
  const Vector3d skull = nape + Vector3d(0, -0.3 * head, 0.15 * head);
  const Vector3d nose = skull + Vector3d(0, -head * body.between(1.1, 1.8), -0.3 * head);
  const int head_joint = body.joint("head", neck.back(), nape, nose, 0.8 * head);
  body.ellipsoid(head_joint, skull, {0.7 * head, 0.85 * head, 0.62 * head}, skin);
  body.cone(head_joint, skull, nose, 0.5 * head, 0.34 * head, skin);
  for (int side : {1, -1})
    body.ball(head_joint, nose + Vector3d(side * 0.2 * head, -0.1 * head, 0.25 * head), 0.14 * head, skin);
  const Vector3d hinge = skull + Vector3d(0, 0, -0.4 * head), chin = nose + Vector3d(0, 0.2 * head, -0.5 * head);
  const int jaw = body.joint("jaw", head_joint, hinge, chin, 0.3 * head);
  body.cone(jaw, hinge, chin, 0.38 * head, 0.24 * head, skin).blend *= 0.4;
  body.bend(jaw, Vector3d::UnitX(), body.between(0.0, 0.35));
  body.swing(jaw, Vector3d::UnitX(), 0.12, 0.5);
  add_eyes(body, head_joint, skull + Vector3d(0, -0.45 * head, 0.35 * head), 0.5 * head, 0.2 * head, {0, -0.3, 0.05});
  add_horns(body, head_joint, skull + Vector3d(0, 0.3 * head, 0.4 * head), 0.35 * head, head * body.between(0.8, 1.6),
            0.2 * head);

  const int tail_count = body.count(3, 8);
  const auto tail = add_tail(body, hips,
                             {rump + Vector3d(0, 0.6 * girth, 0),
                              {0, 1, body.between(-0.3, 0.2)},
                              body.between(0.7, 1.1),
                              0.55 * girth,
                              0.12 * girth,
                              tail_count,
                              body.between(0.0, 0.3)},
                             skin);
  const Vector3d end = body.joints[tail.back()].tail;
  body.sheet({tail.back(), tail.back(), tail.back()},
             {end - Vector3d(0, 0.08, 0), end + Vector3d(0.1, 0.06, 0), end + Vector3d(0, 0.2, 0)}, 0.02, horn, {});
  body.sheet({tail.back(), tail.back(), tail.back()},
             {end - Vector3d(0, 0.08, 0), end + Vector3d(0, 0.2, 0), end + Vector3d(-0.1, 0.06, 0)}, 0.02, horn, {});
  // Spikes along the back.
  const auto spike = [&](int j, double radius, double size) {
    const Vector3d at = 0.5 * (body.joints[j].position + body.joints[j].tail);
    body.cone(j, at + Vector3d(0, 0, 0.8 * radius), at + Vector3d(0, 0.3 * size, radius + size), 0.4 * size,
              0.12 * size, horn)
        .blend *= 0.3;
  };
  if (rng.chance(0.7)) {
    for (int j : neck) spike(j, 0.5 * girth, 0.3 * girth);
    for (int j : spine) spike(j, 0.85 * girth, 0.4 * girth);
    for (std::size_t i = 0; i + 1 < tail.size(); ++i) spike(tail[i], body.joints[tail[i]].radius, 0.3 * girth);
  }

  const int fingers = body.count(2, 4);
  const double span = body.between(0.8, 1.2), lift = body.between(-0.2, 0.6), sweep = body.between(-0.1, 0.5);
  std::vector<int> limbs, tips{jaw, tail.back()};
  for (int side : {1, -1}) {
    const double s = side;
    WingShape shape{withers + Vector3d(s * 0.6 * girth, 0.02, 0.55 * girth),
                    span,
                    span * body.between(0.45, 0.55),
                    0.06,
                    0.014,
                    0.0};
    const auto wing = add_skin_wing(body, chest, side, shape, fingers, skin, wing_skin);
    body.bend(wing[0], Vector3d::UnitY(), -s * lift);
    body.bend(wing[0], Vector3d::UnitZ(), s * sweep);
    body.swing(wing[0], Vector3d::UnitY(), -0.3 * s, 0.0);
    body.swing(wing[1], Vector3d::UnitY(), -0.2 * s, -0.8);
    for (std::size_t f = 2; f < wing.size(); f += 2) body.swing(wing[f], Vector3d::UnitY(), -0.15 * s, -1.4);
  }
  for (int front : {1, 0}) {
    if (front && wyvern) continue;
    for (int side : {1, -1}) {
      const double s = side, y = front ? withers.y() : rump.y(), x = 0.7 * girth;
      const std::string prefix = std::string("leg_") + (front ? "front_" : "back_") + side_name(side) + "_";
      const Vector3d hip(s * x, y, z - 0.1 * girth), knee(s * x * 1.35, y + (front ? 0.05 : -0.1), 0.55 * leg);
      const Vector3d hock(s * x * 1.3, y + (front ? -0.02 : 0.06), 0.22 * leg), sole(s * x * 1.3, y - 0.03, 0.7 * r);
      const auto joints = add_leg(body, front ? chest : hips, prefix, {"upper", "knee", "ankle"},
                                  {hip, knee, hock, sole}, {1.6 * r, 1.1 * r, 0.8 * r, 0.8 * r}, skin);
      for (double turn : {-0.45, 0.0, 0.45}) {
        const Vector3d toe(std::sin(turn), -std::cos(turn), -0.12);
        body.cone(joints.back(), sole, sole + 2.2 * r * toe, 0.5 * r, 0.25 * r, horn);
      }
      const double step = 0.2 * rng.normal();
      body.bend(joints[0], Vector3d::UnitX(), step);
      body.swing(joints[0], Vector3d::UnitX(), 0.05, side > 0 ? 0.0 : 3.1);
      limbs.push_back(joints[0]);
      tips.push_back(joints.back());
    }
  }
  add_rig_habits(body, limbs, tips);
}

}  // namespace anigen::creatures
