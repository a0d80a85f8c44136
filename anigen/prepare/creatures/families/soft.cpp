#include <cmath>

#include "anigen/core/numeric.h"

#include "anigen/prepare/creatures/families/families.h"
#include "anigen/prepare/creatures/families/parts.h"

namespace anigen::prepare {

using Eigen::Vector3d;

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
  const int nail = body.add_paint(plain(monster ? color_of(0.1, 0.3, 0.25) : Eigen::Vector3d(0.9, 0.65, 0.6)));
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

}  // namespace anigen::prepare
