#include "anigen/prepare/creatures/families/families.h"
#include "anigen/prepare/creatures/families/parts.h"
#include "anigen/prepare/creatures/families/wings.h"

namespace anigen::prepare {

using Eigen::Vector3d;

void build_bird(Body& body) {
  Rng& rng = body.rng;
  const double girth = body.between(0.15, 0.24), length = girth * body.between(1.4, 2.1),
               head = girth * body.between(0.5, 0.8);
  const double leg = body.between(0.12, 0.5),
               neck_length = rng.chance(0.25) ? body.between(0.3, 0.6) : body.between(0.06, 0.2);
  const double pitch = body.between(0.1, 0.8);
  body.smoothness = 0.8;
  body.softness = body.between(0.3, 0.8);
  const Paint coat = random_coat(rng, 2.0 * length, Vector3d::UnitY());
  const int feathers = body.add_paint(coat);
  Paint wing_paint = shade(coat, body.between(0.35, 0.9));
  if (rng.chance(0.5)) wing_paint.base = coat.accent;
  const int wing = body.add_paint(wing_paint);
  const int horn =
      body.add_paint(plain(color_of(body.between(0.05, 0.14), body.between(0.4, 0.95), body.between(0.4, 1.0))));

  const int ground = maybe_ground_root(body, 0.15);
  const double z = leg + 0.9 * girth;
  const Vector3d axis = Vector3d(0, -1, pitch).normalized();
  const Vector3d rump = Vector3d(0, 0, z) - 0.35 * length * axis, breast = Vector3d(0, 0, z) + 0.45 * length * axis;
  const int hips = body.joint("hips", ground, rump, Vector3d(0, 0, z), girth);
  const int segments = body.count(1, 3);
  const auto spine = body.limb(hips, numbered("spine", segments),
                               curve({0, 0, z}, Vector3d(0, 0, z) + 0.2 * length * axis, breast, segments),
                               taper(0.8 * girth, 0.8 * girth, segments), feathers);
  body.ellipsoid(spine[0], Vector3d(0, 0, z - 0.03), {0.95 * girth, 0.95 * girth, 0.75 * length}, feathers,
                 frame_along(axis));
  body.cone(hips, rump, rump - 0.3 * length * axis, 0.6 * girth, 0.25 * girth, feathers);
  const int chest = spine.back();

  const int neck_count = neck_length > 0.25 ? body.count(2, 5) : 1;
  const Vector3d collar = breast - 0.05 * length * axis + Vector3d(0, 0, 0.25 * girth);
  const Vector3d nape = collar + neck_length * Vector3d(0, -body.between(0.0, 0.6), 1.0) + Vector3d(0, 0, 0.25 * girth);
  const auto neck =
      body.limb(chest, neck_count == 1 ? std::vector<std::string>{"neck"} : numbered("neck", neck_count),
                curve(collar, 0.5 * (collar + nape) + Vector3d(0, -0.1 * neck_length, 0), nape, neck_count),
                taper(0.65 * girth, 0.6 * head, neck_count), feathers);
  for (int j : neck) {
    body.bend(j, Vector3d::UnitX(), 0.15 * rng.normal());
    body.swing(j, Vector3d::UnitX(), 0.15 / neck_count, 0.2);
  }
  const Vector3d skull = nape + Vector3d(0, -0.2 * head, 0.4 * head);
  const double beak = head * body.between(0.7, 2.0);
  const Vector3d tip = skull + Vector3d(0, -0.8 * head - beak, -body.between(0.1, 0.5) * head);
  const int head_joint = body.joint("head", neck.back(), nape, tip, 0.8 * head);
  body.ball(head_joint, skull, head, feathers);
  const int jaw = rng.chance(0.5) ? body.joint("beak_lower", head_joint, skull + Vector3d(0, -0.6 * head, -0.25 * head),
                                               tip, 0.3 * head)
                                  : -1;
  body.cone(head_joint, skull + Vector3d(0, -0.7 * head, 0), tip, 0.42 * head, 0.09 * head, horn).blend = 0.02 * head;
  if (jaw >= 0) {
    body.cone(jaw, skull + Vector3d(0, -0.6 * head, -0.25 * head), tip + Vector3d(0, 0.3 * beak, -0.25 * head),
              0.3 * head, 0.09 * head, horn)
        .blend = 0.0;
    body.swing(jaw, Vector3d::UnitX(), 0.15, 0.0);
  }
  if (rng.chance(0.4)) {
    for (int k = 0; k < 3; ++k) {
      body.cone(head_joint, skull + Vector3d(0, 0, 0.8 * head),
                skull + Vector3d(0, (0.5 + 0.4 * k) * head, (1.7 - 0.2 * k) * head), 0.2 * head, 0.1 * head, wing);
    }
  }
  add_eyes(body, head_joint, skull + Vector3d(0, -0.5 * head, 0.25 * head), 0.72 * head, 0.26 * head, {0, -0.5, 0});
  body.swing(head_joint, Vector3d::UnitZ(), 0.25, 0.6);

  const double span = body.between(0.45, 1.0) * (rng.chance(0.2) ? 0.6 : 1.0);
  WingShape shape{{}, span, span * body.between(0.3, 0.5), 0.055, 0.014, body.between(0.0, 0.3)};
  const bool spread = rng.chance(0.65);
  const double lift = spread ? body.between(-0.3, 0.6) : 0.0;
  std::vector<int> limbs, tips{head_joint};
  for (int side : {1, -1}) {
    const double s = side;
    shape.shoulder = Vector3d(0, 0, z) + 0.3 * length * axis + Vector3d(s * 0.75 * girth, 0, 0.3 * girth);
    const auto joints = add_feathered_wing(body, chest, side, shape, wing, wing);
    body.bend(joints[0], Vector3d::UnitY(), -s * lift);
    if (!spread) {
      // Half folded: the upper wing swept back, the hand turned in over the tail.
      body.bend(joints[0], Vector3d::UnitZ(), s * body.between(0.3, 0.6));
      body.bend(joints[0], Vector3d::UnitY(), s * body.between(0.3, 0.7));
      body.bend(joints[2], Vector3d::UnitZ(), s * body.between(0.2, 0.5));
    }
    body.swing(joints[0], Vector3d::UnitY(), 0.35 * -s, 0.0);
    body.swing(joints[1], Vector3d::UnitY(), 0.25 * -s, -0.8);
    body.swing(joints[2], Vector3d::UnitY(), 0.25 * -s, -1.4);
    limbs.push_back(joints[0]);
    tips.push_back(joints[2]);
  }
  for (int side : {1, -1}) {
    const double s = side, r = 0.035;
    const Vector3d hip(s * 0.45 * girth, 0.02, z - 0.5 * girth), knee(s * 0.5 * girth, -0.03, 0.55 * leg + 0.1 * girth);
    const Vector3d ankle(s * 0.5 * girth, 0.0, 0.03);
    const auto joints = add_leg(body, hips, "leg_" + side_name(side) + "_", {"upper", "lower"}, {hip, knee, ankle},
                                {0.08, 0.045, r}, horn);
    body.cone(joints[0], hip, 0.5 * (hip + knee), 0.09, 0.06, feathers);
    const int foot = body.joint("foot_" + side_name(side), joints[1], ankle, ankle + Vector3d(0, -0.1, -0.01), r);
    for (double turn : {-0.5, 0.0, 0.5, 3.14}) {
      const Vector3d toe(std::sin(turn), -std::cos(turn), -0.05);
      body.cone(foot, ankle, ankle + (turn > 3 ? 0.07 : 0.13) * toe, 0.028, 0.02, horn);
    }
    limbs.push_back(joints[1]);
    tips.push_back(foot);
  }
  const int fan = body.count(1, 3);
  const Vector3d vent = rump - 0.3 * length * axis;
  const double tail_length = body.between(0.2, 0.5);
  const int tail = body.joint("tail", hips, vent, vent + Vector3d(0, tail_length, -0.05), 0.1);
  body.swing(tail, Vector3d::UnitX(), 0.15, 1.0);
  for (int k = -fan; k <= fan; ++k) {
    const double a = 0.22 * k, b = 0.22 * (k + 0.9);
    const auto point = [&](double turn) {
      return Vector3d(vent + tail_length * Vector3d(std::sin(turn), std::cos(turn), -0.25));
    };
    body.sheet({tail, tail, tail}, {vent + Vector3d(0, -0.06, 0.02), point(a - 0.1), point(b - 0.1)}, 0.014, wing, {});
  }
  add_rig_habits(body, limbs, tips);
}

}  // namespace anigen::prepare
