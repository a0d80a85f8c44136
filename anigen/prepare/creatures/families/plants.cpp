#include <cmath>

#include "anigen/core/numeric.h"

#include "anigen/prepare/creatures/families/families.h"
#include "anigen/prepare/creatures/families/parts.h"

namespace anigen::prepare {
namespace {

using Eigen::Vector3d;

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
    for (std::size_t i = 0; i < chain.size(); ++i)
      body.swing(chain[i], Vector3d(1, 0.3, 0), 0.12 / segments, -0.4 * static_cast<double>(i));
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
  for (std::size_t i = 0; i < trunk.size(); ++i)
    body.swing(trunk[i], Vector3d(1, 0.4, 0), 0.06 / segments, -0.3 * static_cast<double>(i));
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

}  // namespace anigen::prepare
