#include "anigen/prepare/creatures/body.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace anigen::prepare {

using Eigen::Vector3d;

int Body::add_paint(const Paint& paint) {
  paints.push_back(paint);
  return static_cast<int>(paints.size()) - 1;
}

int Body::joint(const std::string& name, int parent, const Vector3d& position, const Vector3d& tail, double radius) {
  BodyJoint joint;
  joint.name = name;
  joint.parent = parent;
  joint.position = position;
  joint.tail = tail;
  joint.radius = radius;
  joints.push_back(joint);
  bends_.push_back(Eigen::Quaterniond::Identity());
  return static_cast<int>(joints.size()) - 1;
}

int Body::end_joint(const std::string& name, int parent) {
  const BodyJoint of = joints[parent];
  const int j = joint(name, parent, of.tail, of.tail + 0.3 * (of.tail - of.position), of.radius);
  joints[j].carries_skin = false;
  return j;
}

int Body::twist_joint(const std::string& name, int of, double at) {
  const BodyJoint bone = joints[of];
  const int j = joint(name, of, bone.position + at * (bone.tail - bone.position), bone.tail, bone.radius);
  joints[j].twist_of = of;
  return j;
}

Primitive& Body::add(const Primitive& primitive) {
  primitives.push_back(primitive);
  return primitives.back();
}

Primitive& Body::cone(int joint, const Vector3d& a, const Vector3d& b, double ra, double rb, int paint) {
  Primitive p;
  p.shape = Primitive::Shape::kCone;
  p.a = a;
  p.b = b;
  p.ra = ra;
  p.rb = rb;
  p.blend = smoothness * std::min(ra, rb);
  p.joint = joint;
  p.anchors = {joint, joint, joint};
  p.paint = paint;
  return add(p);
}

Primitive& Body::ball(int joint, const Vector3d& center, double radius, int paint) {
  return cone(joint, center, center, radius, radius, paint);
}

Primitive& Body::ellipsoid(int joint, const Vector3d& center, const Vector3d& half, int paint,
                           const Eigen::Matrix3d& axes) {
  Primitive p;
  p.shape = Primitive::Shape::kEllipsoid;
  p.a = center;
  p.half = half;
  p.axes = axes;
  p.blend = smoothness * half.minCoeff();
  p.joint = joint;
  p.anchors = {joint, joint, joint};
  p.paint = paint;
  return add(p);
}

Primitive& Body::box(int joint, const Vector3d& center, const Vector3d& half, double rounding, int paint,
                     const Eigen::Matrix3d& axes) {
  Primitive& p = ellipsoid(joint, center, half, paint, axes);
  p.shape = Primitive::Shape::kBox;
  p.ra = std::min(rounding, half.minCoeff());
  return p;
}

Primitive& Body::cylinder(int joint, const Vector3d& a, const Vector3d& b, double ra, double rb, double rounding,
                          int paint) {
  Primitive& p = cone(joint, a, b, ra, rb, paint);
  p.shape = Primitive::Shape::kCylinder;
  p.half.x() = std::min({rounding, 0.9 * ra, 0.9 * rb, 0.45 * (b - a).norm()});
  return p;
}

Primitive& Body::sheet(const std::array<int, 3>& anchors, const std::array<Vector3d, 3>& corners, double thickness,
                       int paint, const std::vector<int>& owners) {
  Primitive p;
  p.shape = Primitive::Shape::kSheet;
  p.a = corners[0];
  p.b = corners[1];
  p.c = corners[2];
  p.ra = thickness;
  p.blend = smoothness * thickness;
  p.joint = anchors[0];
  p.anchors = anchors;
  p.owners = owners;
  p.paint = paint;
  return add(p);
}

void Body::eye(int joint, const Vector3d& center, double radius, const Vector3d& look, int paint) {
  Primitive& p = ball(joint, center, radius, paint);
  p.blend = 0.0;
  p.center = center;
  p.look = look.normalized();
}

std::vector<int> Body::limb(int parent, const std::vector<std::string>& names, const std::vector<Vector3d>& points,
                            const std::vector<double>& radii, int paint) {
  std::vector<int> chain;
  for (std::size_t i = 0; i < names.size(); ++i) {
    parent = joint(names[i], parent, points[i], points[i + 1], radii[i]);
    cone(parent, points[i], points[i + 1], radii[i], radii[i + 1], paint);
    chain.push_back(parent);
  }
  return chain;
}

void Body::swing(int joint, const Vector3d& axis, double amplitude, double phase) {
  swings.push_back({joint, axis.normalized(), amplitude, phase});
}

void Body::bend(int joint, const Vector3d& axis, double angle) {
  bends_[joint] = Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis.normalized())) * bends_[joint];
}

void Body::bend_randomly(int joint, double angle) {
  Vector3d axis(rng.normal(), rng.normal(), rng.normal());
  if (axis.norm() < 1e-6) axis = Vector3d::UnitX();
  bend(joint, axis, angle * std::clamp(rng.normal(), -2.0, 2.0));
}

void Body::apply_pose() {
  for (std::size_t j = 0; j < joints.size(); ++j) {
    BodyJoint& joint = joints[j];
    const Eigen::Affine3d parent = joint.parent < 0 ? Eigen::Affine3d::Identity() : joints[joint.parent].posed;
    joint.posed = parent * Eigen::Translation3d(joint.position) * bends_[j] * Eigen::Translation3d(-joint.position);
  }
  for (Primitive& p : primitives) {
    p.a = joints[p.anchors[0]].posed * p.a;
    p.b = joints[p.anchors[1]].posed * p.b;
    p.c = joints[p.anchors[2]].posed * p.c;
    p.axes = joints[p.joint].posed.linear() * p.axes;
    settle(p);
  }
  for (BodyJoint& joint : joints) {
    joint.position = joint.posed * joint.position;
    joint.tail = joint.posed * joint.tail;
  }
}

std::string side_name(int side) { return side > 0 ? "left" : "right"; }

std::vector<std::string> numbered(const std::string& name, int count) {
  std::vector<std::string> names;
  for (int i = 1; i <= count; ++i) {
    char number[16];
    std::snprintf(number, sizeof number, "_%02d", i);
    names.push_back(name + number);
  }
  return names;
}

std::vector<Vector3d> curve(const Vector3d& from, const Vector3d& control, const Vector3d& to, int count) {
  std::vector<Vector3d> points;
  for (int i = 0; i <= count; ++i) {
    const double t = static_cast<double>(i) / count;
    points.push_back((1 - t) * (1 - t) * from + 2 * t * (1 - t) * control + t * t * to);
  }
  return points;
}

std::vector<double> taper(double from, double to, int count, double bulge) {
  std::vector<double> radii;
  for (int i = 0; i <= count; ++i) {
    const double t = static_cast<double>(i) / count;
    radii.push_back((from + (to - from) * t) * (1.0 + (bulge - 1.0) * 4.0 * t * (1.0 - t)));
  }
  return radii;
}

Eigen::Matrix3d frame_along(const Vector3d& z, const Vector3d& x) {
  const Vector3d third = z.normalized();
  Vector3d first = x - third * third.dot(x);
  if (first.norm() < 1e-6) first = third.unitOrthogonal();
  first.normalize();
  Eigen::Matrix3d frame;
  frame << first, third.cross(first), third;
  return frame;
}

}  // namespace anigen::prepare
