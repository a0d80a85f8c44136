#include "anigen/prepare/creatures/families/families.h"
#include "anigen/prepare/creatures/families/parts.h"

namespace anigen::prepare {

using Eigen::Vector3d;

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
  for (std::size_t i = 0; i < spine.size(); ++i) body.swing(spine[i], Vector3d::UnitX(), 0.02, -0.5 * i);
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

}  // namespace anigen::prepare
