#include <algorithm>
#include <cmath>

#include "anigen/core/numeric.h"
#include "anigen/creatures/parts.h"

namespace anigen::creatures {

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

void add_pot(Body& body, int root, double top, double radius) {
  Paint clay = plain(body.rng.chance(0.6) ? color_of(body.between(0.02, 0.07), 0.6, body.between(0.5, 0.85))
                                          : color_of(body.rng.uniform(), 0.5, 0.8));
  const int pot = body.add_paint(clay), rim = body.add_paint(shade(clay, 0.75));
  const int soil = body.add_paint(plain(color_of(0.07, 0.6, 0.22)));
  body.cylinder(root, {0, 0, 0}, {0, 0, 0.85 * top}, 0.7 * radius, 0.95 * radius, 0.03, pot).blend = 0.0;
  body.cylinder(root, {0, 0, 0.8 * top}, {0, 0, top}, 1.08 * radius, 1.08 * radius, 0.025, rim).blend = 0.0;
  body.ellipsoid(root, {0, 0, 0.97 * top}, {0.85 * radius, 0.85 * radius, 0.1 * top}, soil).blend = 0.0;
}

/// A leaf of one or two joints: flat, pointed, a little folded downwards.
int add_leaf(Body& body, int parent, const std::string& name, const Vector3d& from, const Vector3d& direction,
             double length, double width, bool two, int paint) {
  const Vector3d along = direction.normalized();
  Vector3d across = along.cross(Vector3d::UnitZ());
  across = across.norm() > 1e-3 ? Vector3d(across.normalized()) : Vector3d::UnitX();
  const Vector3d droop(0, 0, -0.2 * length);
  const Vector3d middle = from + 0.5 * length * along, tip = from + length * along + droop;
  const int leaf = body.joint(name, parent, from, two ? middle : tip, 0.5 * width);
  const int end = two ? body.joint(name + "_tip", leaf, middle, tip, 0.5 * width) : leaf;
  const double t = 0.014;
  const Vector3d left = from + 0.42 * length * along + width * across + 0.3 * droop,
                 right = left - 2.0 * width * across;
  body.sheet({leaf, leaf, leaf}, {from, left, middle}, t, paint, {});
  body.sheet({leaf, leaf, leaf}, {from, middle, right}, t, paint, {});
  body.sheet({end, end, end}, {middle, left, tip}, t, paint, {});
  body.sheet({end, end, end}, {middle, tip, right}, t, paint, {});
  body.cone(leaf, from, middle, 0.025, 0.02, paint);
  body.swing(leaf, across, 0.12, body.between(0.0, 6.0));
  if (two) body.swing(end, across, 0.15, body.between(0.0, 6.0));
  return end;
}

}  // namespace

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

void build_plant(Body& body) {
  Rng& rng = body.rng;
  const double hue = body.between(0.2, 0.42);
  const int stem = body.add_paint(plain(color_of(hue, 0.6, body.between(0.35, 0.7))));
  Paint leaf_paint = random_coat(rng, 1.2, Vector3d::UnitZ());
  leaf_paint.base = color_of(hue, body.between(0.5, 0.85), body.between(0.4, 0.85));
  leaf_paint.under = 0.7 * leaf_paint.base;
  leaf_paint.accent = color_of(hue + 0.06, 0.5, 0.9);
  const int leaves = body.add_paint(leaf_paint);
  body.smoothness = 0.5;
  body.softness = body.between(0.8, 2.5);
  const double pot_height = body.between(0.22, 0.36), pot_radius = body.between(0.18, 0.3);
  const int root = body.joint("base", -1, {0, 0, 0}, {0, 0, pot_height}, pot_radius);
  add_pot(body, root, pot_height, pot_radius);
  const int stems = rng.chance(0.55) ? 1 : body.count(2, 4);
  const double height = body.between(0.7, 1.3);
  for (int n = 0; n < stems; ++n) {
    const double turn = 2.0 * kPi * (n + body.between(0.0, 0.5)) / stems;
    const Vector3d lean(std::cos(turn), std::sin(turn), 0);
    const double away = stems == 1 ? body.between(0.0, 0.25) : body.between(0.25, 0.45);
    const double tall = height * (stems == 1 ? 1.0 : body.between(0.6, 1.0));
    const Vector3d from = Vector3d(0, 0, pot_height) + (stems == 1 ? 0.0 : 0.4 * pot_radius) * lean;
    const int segments = body.count(2, stems == 1 ? 7 : 4);
    const auto points =
        curve(from, from + Vector3d(0, 0, 0.6 * tall), from + away * lean + Vector3d(0, 0, tall), segments);
    const std::string name = stems == 1 ? "stem" : "stem_" + std::string(1, static_cast<char>('a' + n));
    const auto chain = body.limb(root, numbered(name, segments), points, taper(0.045, 0.03, segments), stem);
    body.swing_chain(chain, Vector3d(1, 0.3, 0), 0.12 / segments, 0.4);
    const int per = stems == 1 ? body.count(1, 3) : body.count(0, 2);
    int number = 0;
    double at = turn;
    for (std::size_t i = 0; i < chain.size(); ++i) {
      for (int k = 0; k < per && body.joints.size() < 46; ++k) {
        at += 2.4;  // the golden angle, as leaves grow
        const Vector3d direction(std::cos(at), std::sin(at), body.between(0.1, 0.6));
        const double length = body.between(0.25, 0.45) * (1.1 - 0.4 * static_cast<double>(i) / segments);
        add_leaf(body, chain[i], numbered(name + "_leaf", ++number).back(),
                 points[i] + 0.6 * (points[i + 1] - points[i]), direction, length, length * body.between(0.18, 0.32),
                 body.rng.chance(0.5), leaves);
      }
    }
    const Vector3d top = points.back();
    const double kind = rng.uniform();
    if (kind < 0.75) {
      // A flower that looks along the stem.
      const Vector3d face =
          (Vector3d(0, -0.6, 0.4) + (points[segments] - points[segments - 1]).normalized()).normalized();
      const double heart = body.between(0.07, 0.12);
      const int flower = body.joint(name + "_flower", chain.back(), top, top + heart * face, heart);
      const int middle = body.add_paint(plain(color_of(body.between(0.05, 0.16), 0.85, body.between(0.3, 0.95))));
      Paint petal_paint = plain(color_of(rng.uniform(), body.between(0.3, 0.9), 0.95));
      const int petals = body.add_paint(petal_paint);
      const Eigen::Matrix3d frame = frame_along(face);
      const int count = body.count(5, 9);
      const double length = heart * body.between(1.4, 2.4), width = kPi * (heart + 0.5 * length) / count * 0.8;
      for (int k = 0; k < count; ++k) {
        const double a = 2.0 * kPi * k / count;
        const Vector3d out = std::cos(a) * frame.col(0) + std::sin(a) * frame.col(1) + 0.25 * face;
        Eigen::Matrix3d axes;
        axes.col(2) = out.normalized();
        axes.col(0) = face.cross(axes.col(2)).normalized();
        axes.col(1) = axes.col(2).cross(axes.col(0));
        body.ellipsoid(flower, top + (heart + 0.4 * length) * axes.col(2), {width, 0.02, 0.62 * length}, petals, axes)
            .blend = 0.01;
      }
      body.ellipsoid(flower, top + 0.25 * heart * face, {heart, heart, 0.55 * heart}, middle, frame).blend = 0.0;
      body.swing(flower, Vector3d::UnitX(), 0.15, 0.5 + n);
    } else {
      add_leaf(body, chain.back(), name + "_top", top, Vector3d(0.2, -0.3, 1.0), 0.35, 0.08, true, leaves);
    }
  }
}

void build_tree(Body& body) {
  Rng& rng = body.rng;
  const int bark = body.add_paint([&] {
    Paint paint = plain(color_of(body.between(0.04, 0.1), body.between(0.2, 0.6), body.between(0.25, 0.6)));
    paint.pattern = Paint::Pattern::kMottled;
    paint.accent = 0.45 * paint.base;
    paint.frequency = 10.0;
    return paint;
  }());
  Paint crown = plain(color_of(rng.chance(0.75) ? body.between(0.2, 0.4) : body.between(0.0, 0.14),
                               body.between(0.5, 0.85), body.between(0.4, 0.8)));
  crown.pattern = Paint::Pattern::kMottled;
  crown.accent = 1.5 * crown.base;
  crown.frequency = 6.0;
  crown.down = -Vector3d::UnitZ();
  crown.under = 0.45 * crown.base;
  const int foliage = body.add_paint(crown);
  const bool bare = rng.chance(0.12), conifer = !bare && rng.chance(0.25);
  body.smoothness = 0.6;
  body.softness = body.between(0.6, 1.6);
  const double height = body.between(0.5, 1.0), girth = body.between(0.06, 0.11);
  const int segments = body.count(2, 5);
  const int root = body.joint("root", -1, {0, 0, 0}, {0, 0, 0.1}, 1.4 * girth);
  const int toes = body.count(3, 6);
  for (int k = 0; k < toes; ++k) {
    const double a = 2.0 * kPi * (k + body.between(0.0, 0.4)) / toes;
    body.cone(root, {0, 0, 0.12}, {2.4 * girth * std::cos(a), 2.4 * girth * std::sin(a), 0.02}, 0.9 * girth,
              0.4 * girth, bark);
  }
  const Vector3d top(0.15 * rng.normal(), 0.15 * rng.normal(), height);
  const auto points = curve({0, 0, 0.06}, {0.1 * rng.normal(), 0.1 * rng.normal(), 0.5 * height}, top, segments);
  const auto trunk =
      body.limb(root, numbered("trunk", segments), points, taper(1.2 * girth, 0.7 * girth, segments), bark);
  body.swing_chain(trunk, Vector3d(1, 0.4, 0), 0.06 / segments, 0.3);
  if (conifer) {
    const int tiers = body.count(3, 5);
    int parent = trunk.back();
    const double crown_height = body.between(0.8, 1.3), wide = body.between(0.35, 0.55);
    const Vector3d base = points[segments - 1];
    for (int k = 0; k < tiers; ++k) {
      const double t = static_cast<double>(k) / tiers;
      const Vector3d low = base + Vector3d(0, 0, crown_height * t * 0.85),
                     high = low + Vector3d(0, 0, 1.4 * crown_height / tiers);
      parent = body.joint(numbered("crown", tiers)[k], parent, low, low + Vector3d(0, 0, 0.85 * crown_height / tiers),
                          wide * (1.0 - 0.75 * t));
      body.cylinder(parent, low, high, wide * (1.05 - 0.8 * t), 0.06 + 0.25 * wide * (1.0 - t), 0.04, foliage).blend =
          0.02;
      body.swing(parent, Vector3d(1, 0.3, 0), 0.05, -0.4 * k);
    }
    return;
  }
  const int branches = body.count(3, 6);
  const bool forked = rng.chance(0.6);
  for (int b = 0; b < branches; ++b) {
    const double a = 2.4 * b + body.between(-0.3, 0.3), low = b == 0 ? 1.0 : body.between(0.65, 1.0);
    const std::size_t at =
        std::min<std::size_t>(trunk.size() - 1, static_cast<std::size_t>(low * static_cast<double>(trunk.size())));
    const Vector3d from = points[at] + (low * segments - static_cast<double>(at)) * 0.9 * (points[at + 1] - points[at]);
    const Vector3d out = Vector3d(std::cos(a), std::sin(a), body.between(0.5, 1.3)).normalized();
    const double length = bare ? body.between(0.5, 0.85) : body.between(0.35, 0.6);
    const Vector3d tip = from + length * out + Vector3d(0, 0, 0.1);
    const std::string name = "branch_" + std::string(1, static_cast<char>('a' + b));
    const int parts = body.count(2, 3);
    const auto branch = body.limb(trunk[at], numbered(name, parts), curve(from, from + 0.5 * length * out, tip, parts),
                                  taper(0.55 * girth, 0.3 * girth, parts), bark);
    for (int j : branch) body.swing(j, Vector3d(out.y(), -out.x(), 0), 0.05, body.between(0.0, 6.0));
    const auto tuft = [&](int j, const Vector3d& center, double size) {
      body.ellipsoid(j, center, {size, size * body.between(0.85, 1.1), size * body.between(0.65, 0.9)}, foliage).blend =
          0.25 * size;
      for (int k = 0; k < 4; ++k) {
        const Vector3d bump = Vector3d(rng.normal(), rng.normal(), 0.6 * rng.normal()).normalized() * 0.75 * size;
        body.ball(j, center + bump, 0.5 * size, foliage).blend = 0.12 * size;
      }
    };
    if (!bare) tuft(branch.back(), tip, body.between(0.18, 0.3));
    if (forked || bare) {
      const Vector3d side = (out + 0.9 * Vector3d(-out.y(), out.x(), 0.2)).normalized();
      const Vector3d fork = body.joints[branch[0]].tail, end = fork + 0.6 * length * side;
      const auto twig = body.limb(branch[0], {name + "_twig"}, {fork, end}, {0.35 * girth, 0.22 * girth}, bark);
      body.swing(twig[0], Vector3d::UnitX(), 0.08, body.between(0.0, 6.0));
      if (!bare) tuft(twig[0], end, body.between(0.12, 0.2));
    }
  }
}

}  // namespace anigen::creatures
