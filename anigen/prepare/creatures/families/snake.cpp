#include <cmath>

#include "anigen/core/numeric.h"

#include "anigen/prepare/creatures/families/families.h"
#include "anigen/prepare/creatures/families/parts.h"

namespace anigen::prepare {

using Eigen::Vector3d;

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
  std::vector<int> forward;
  int parent = root;
  const auto names = numbered("spine", segments - middle);
  for (int i = middle; i < segments; ++i) {
    parent =
        body.joint(names[i - middle], parent, points[i], points[i + 1], thickness(static_cast<double>(i) / segments));
    wrap(parent, i, i + 1);
    forward.push_back(parent);
  }
  const int neck = parent;
  parent = root;
  const auto tail_names = numbered("tail", std::max(middle, 1));
  for (int i = middle; i > 0; --i) {
    parent = body.joint(tail_names[middle - i], parent, points[i], points[i - 1],
                        thickness(static_cast<double>(i) / segments));
    wrap(parent, i, i - 1);
    forward.push_back(parent);
  }
  for (std::size_t i = 0; i < forward.size(); ++i) {
    body.swing(forward[i], Vector3d::UnitZ(), 1.1 / segments, -1.2 * static_cast<double>(i));
  }
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
  add_rig_habits(body, {}, {parent, jaw});
}

}  // namespace anigen::prepare
