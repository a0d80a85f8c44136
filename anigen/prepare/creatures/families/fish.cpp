#include <algorithm>
#include <cmath>

#include "anigen/prepare/creatures/families/families.h"
#include "anigen/prepare/creatures/families/parts.h"

namespace anigen::prepare {

using Eigen::Vector3d;

namespace {

/// A fin of rays spread in a plane between two directions.
int add_fin(Body& body, int parent, const std::string& name, const Vector3d& base_a, const Vector3d& base_b,
            const Vector3d& tip_a, const Vector3d& tip_b, double thickness, int paint) {
  const Vector3d base = 0.5 * (base_a + base_b);
  const int fin = body.joint(name, parent, base, 0.5 * (tip_a + tip_b), 0.4 * (base_a - base_b).norm());
  body.sheet({fin, fin, fin}, {base_a, base_b, tip_a}, thickness, paint, {});
  body.sheet({fin, fin, fin}, {base_b, tip_b, tip_a}, thickness, paint, {});
  return fin;
}

}  // namespace

void build_fish(Body& body) {
  Rng& rng = body.rng;
  const double length = 1.2, high = body.between(0.13, 0.36), wide = high * body.between(0.4, 0.9);
  const bool shark = rng.chance(0.3);
  body.smoothness = 0.6;
  body.softness = body.between(0.5, 1.2);
  const Paint scales = random_coat(rng, 0.8 * length, rng.chance(0.5) ? Vector3d::UnitY() : Vector3d::UnitZ());
  const int skin = body.add_paint(scales);
  Paint fin_paint = shade(scales, body.between(0.5, 1.3));
  if (rng.chance(0.6))
    fin_paint.base = fin_paint.under = color_of(rng.uniform(), body.between(0.3, 0.9), body.between(0.5, 1.0));
  fin_paint.down.setZero();
  const int fins = body.add_paint(fin_paint);

  // The root sits in the middle of the body: the head is rigid in front of it, the tail swings behind.
  const int segments = body.count(3, 8);
  const Vector3d middle(0, -0.1 * length, 0), end(0, 0.45 * length, 0);
  const int root = body.joint("body", -1, middle, middle + Vector3d(0, 0.1, 0), high);
  const auto points = curve(middle, 0.5 * (middle + end), end, segments);
  const double fullness = body.between(0.8, 1.15);
  const auto radius = [&](double y) {  // half height at a place along the body
    const double t = std::pow(std::clamp(y / length + 0.5, 0.0, 1.0), fullness);
    static constexpr double kProfile[] = {0.3, 0.72, 0.95, 1.0, 0.94, 0.8, 0.62, 0.43, 0.27, 0.17, 0.14};
    const int i = std::min(static_cast<int>(10.0 * t), 9);
    return high * (kProfile[i] + (10.0 * t - i) * (kProfile[i + 1] - kProfile[i]));
  };
  std::vector<int> tail;
  int parent = root;
  const auto names = numbered("tail", segments);
  for (int i = 0; i < segments; ++i) {
    parent = body.joint(names[i], parent, points[i], points[i + 1], radius(points[i].y()));
    tail.push_back(parent);
    body.swing(parent, Vector3d::UnitZ(), 0.6 / segments, -0.9 * i);
    body.bend(parent, Vector3d::UnitZ(), (0.35 / segments) * rng.normal());
  }
  const int slices = 16;
  for (int i = 0; i < slices; ++i) {
    const double y = (-0.42 + 0.86 * i / (slices - 1)) * length, h = radius(y);
    int owner = root;
    for (std::size_t k = 0; k < tail.size(); ++k) {
      if (y > points[k].y()) owner = tail[k];
    }
    Primitive& p = body.ellipsoid(owner, {0, y, 0}, {std::max(wide * h / high, 0.02), 0.075 * length, h}, skin);
    p.blend = 0.5 * h;
  }
  const double nose_y = -0.5 * length;
  const int head = body.joint("head", root, {0, -0.25 * length, 0}, {0, nose_y, 0}, 0.9 * high);
  body.cone(head, {0, -0.3 * length, 0}, {0, nose_y, shark ? 0.1 * high : -0.05 * high}, 0.66 * wide,
            (shark ? 0.2 : 0.4) * wide, skin);
  const int jaw = body.joint("jaw", head, {0, -0.36 * length, -0.25 * high}, {0, nose_y, -0.25 * high}, 0.4 * high);
  body.cone(jaw, {0, -0.36 * length, -0.25 * high}, {0, nose_y + 0.06, -0.3 * high}, 0.45 * wide, 0.28 * wide, skin);
  body.swing(jaw, Vector3d::UnitX(), 0.12, 0.0);
  add_eyes(body, head, {0, -0.36 * length, 0.25 * high}, 0.7 * wide, std::max(0.15 * high, 0.035), {0, -0.2, 0});

  const double t = 0.015;
  const double fork = body.between(0.05, 0.25), sweep = body.between(0.15, 0.3), reach = high * body.between(0.8, 1.5);
  const Vector3d stem(0, 0.42 * length, 0), up(0, 0, 0.05);
  const int upper = add_fin(body, tail.back(), "tail_fin_upper", stem - up, stem + up,
                            stem + Vector3d(0, fork * 0.5, 0), stem + Vector3d(0, sweep + 0.1, reach), t, fins);
  const int lower =
      add_fin(body, tail.back(), "tail_fin_lower", stem + up, stem - up, stem + Vector3d(0, fork * 0.5, 0),
              stem + Vector3d(0, sweep, -(shark ? 0.5 : 0.9) * reach), t, fins);
  for (int fin : {upper, lower}) body.swing(fin, Vector3d::UnitZ(), 0.25, -0.9 * segments);
  const double front = body.between(-0.25, -0.05) * length, back = front + body.between(0.15, 0.4) * length;
  const double fin_height = high * body.between(0.5, 1.1);
  const int dorsal = add_fin(body, root, "dorsal_fin", {0, front, 0.8 * radius(front)}, {0, back, 0.8 * radius(back)},
                             {0, front + 0.15, radius(front) + fin_height},
                             {0, back + 0.08, radius(back) + 0.5 * fin_height}, t, fins);
  body.swing(dorsal, Vector3d::UnitY(), 0.1, 1.0);
  const Vector3d vent(0, 0.15 * length, -0.85 * radius(0.15 * length));
  add_fin(body, tail[0], "anal_fin", vent, vent + Vector3d(0, 0.12, 0.02), vent + Vector3d(0, 0.12, -0.4 * high),
          vent + Vector3d(0, 0.2, -0.25 * high), t, fins);
  std::vector<int> tips{upper, lower, head};
  const double spread = body.between(0.5, 1.2), fin_length = body.between(0.15, 0.35);
  for (int side : {1, -1}) {
    const double s = side;
    const Vector3d base(s * 0.7 * wide, -0.2 * length, -0.3 * high);
    const Vector3d out = Vector3d(s * spread, 0.8, -0.4).normalized() * fin_length;
    const int fin = add_fin(body, root, "pectoral_fin_" + side_name(side), base, base + Vector3d(0, 0.1, 0), base + out,
                            base + 0.8 * out + Vector3d(0, 0.12, 0), t, fins);
    body.swing(fin, Vector3d::UnitY(), 0.4 * s, 0.7);
    tips.push_back(fin);
  }
  add_rig_habits(body, {}, tips);
}

}  // namespace anigen::prepare
