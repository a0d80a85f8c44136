#include "anigen/prepare/creatures/families/families.h"
#include "anigen/prepare/creatures/families/parts.h"
#include "anigen/prepare/creatures/families/wings.h"

namespace anigen::prepare {

using Eigen::Vector3d;

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

}  // namespace anigen::prepare
