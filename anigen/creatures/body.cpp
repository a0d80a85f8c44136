#include "anigen/creatures/body.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/text.h"
#include "anigen/creatures/parts.h"
#include "anigen/creatures/surface.h"

namespace anigen::creatures {

using Eigen::Matrix3d;
using Eigen::Vector3d;

int Body::add_paint(const Paint& paint) {
  paints.push_back(paint);
  return static_cast<int>(paints.size()) - 1;
}

int Body::joint(const std::string& name, int parent, const Vector3d& position, const Vector3d& tail, double radius) {
  joints.push_back({name, parent, position, tail, radius});
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

Primitive& Body::add(Primitive::Shape shape, int joint, double thickness, int paint) {
  Primitive& p = primitives.emplace_back();
  p.shape = shape;
  p.blend = smoothness * thickness;
  p.joint = joint;
  p.anchors = {joint, joint, joint};
  p.paint = paint;
  return p;
}

Primitive& Body::cone(int joint, const Vector3d& a, const Vector3d& b, double ra, double rb, int paint) {
  Primitive& p = add(Primitive::Shape::kCone, joint, std::min(ra, rb), paint);
  p.a = a;
  p.b = b;
  p.ra = ra;
  p.rb = rb;
  return p;
}

Primitive& Body::ball(int joint, const Vector3d& center, double radius, int paint) {
  return cone(joint, center, center, radius, radius, paint);
}

Primitive& Body::ellipsoid(int joint, const Vector3d& center, const Vector3d& half, int paint,
                           const Eigen::Matrix3d& axes) {
  Primitive& p = add(Primitive::Shape::kEllipsoid, joint, half.minCoeff(), paint);
  p.a = center;
  p.half = half;
  p.axes = axes;
  return p;
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
  Primitive& p = add(Primitive::Shape::kSheet, anchors[0], thickness, paint);
  p.a = corners[0];
  p.b = corners[1];
  p.c = corners[2];
  p.ra = thickness;
  p.anchors = anchors;
  p.owners = owners;
  return p;
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

void Body::swing_chain(const std::vector<int>& chain, const Vector3d& axis, double amplitude, double lag) {
  for (std::size_t i = 0; i < chain.size(); ++i) swing(chain[i], axis, amplitude, -lag * static_cast<double>(i));
}

void Body::scale_blends(int joint, double factor) {
  for (Primitive& p : primitives) {
    if (p.joint == joint) p.blend *= factor;
  }
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

const Primitive& nearest_primitive(const Body& body, const Surface& surface, std::size_t vertex) {
  const std::vector<int>& near = surface.lists[surface.vertex_lists[vertex]];
  const auto distance = [&](int i) { return std::abs(signed_distance(body.primitives[i], surface.vertices[vertex])); };
  return body
      .primitives[*std::min_element(near.begin(), near.end(), [&](int a, int b) { return distance(a) < distance(b); })];
}

namespace {

/// Form in which the joints of a body are written: their order and the orientation of their frames, which differ
/// between real files as much as between two of these.
struct RigStyle {
  enum class Frames { kWorld, kBoneAlongY, kBoneAlongX };
  Frames frames = Frames::kWorld;          ///< joint axes parallel to the world's, or one of them along the bone
  std::vector<int> order;                  ///< body joint of every skeleton joint; parents before children
  std::vector<int> position;               ///< the inverse of `order`
  std::vector<Eigen::Vector3d> placement;  ///< per body joint: how far from the exact centre a hand would have put it
};

RigStyle random_style(const Body& body, Rng& rng) {
  constexpr double kPlacementError = 0.02;  // of the bone, per axis
  RigStyle style;
  const double kind = rng.uniform();
  style.frames = kind < 0.45   ? RigStyle::Frames::kWorld
                 : kind < 0.85 ? RigStyle::Frames::kBoneAlongY
                               : RigStyle::Frames::kBoneAlongX;
  const int count = static_cast<int>(body.joints.size());
  std::vector<std::vector<int>> children(count);
  for (int j = 1; j < count; ++j) children[body.joints[j].parent].push_back(j);
  // Depth first (Blender, Maya), breadth first, or any order in which parents come first.
  const double habit = rng.uniform();
  std::vector<int> open{0};
  while (!open.empty()) {
    const std::size_t pick = habit < 0.6 ? open.size() - 1 : habit < 0.85 ? 0 : rng.index(open.size());
    const int j = open[pick];
    open.erase(open.begin() + static_cast<std::ptrdiff_t>(pick));
    style.order.push_back(j);
    if (habit < 0.6) {
      open.insert(open.end(), children[j].rbegin(), children[j].rend());
    } else {
      open.insert(open.end(), children[j].begin(), children[j].end());
    }
  }
  style.position.resize(count);
  for (int i = 0; i < count; ++i) style.position[style.order[i]] = i;
  // Joints placed by hand miss by a few per cent of the bone. Without that, segments of equal length would give equal
  // bones, which a skeleton encoder that sees only the way from parent to joint cannot tell apart.
  for (const BodyJoint& joint : body.joints) {
    const double bone = joint.parent < 0 ? 0.0 : (joint.position - body.joints[joint.parent].position).norm();
    style.placement.emplace_back(kPlacementError * bone * Vector3d(rng.normal(), rng.normal(), rng.normal()));
  }
  return style;
}

/// The posed body's joints as a skeleton whose rest pose is its bind pose.
Skeleton make_skeleton(const Body& body, const RigStyle& style) {
  Skeleton skeleton;
  for (int j : style.order) {
    const BodyJoint& joint = body.joints[j];
    skeleton.names.push_back(joint.name);
    skeleton.parents.push_back(joint.parent < 0 ? -1 : style.position[joint.parent]);
    Eigen::Matrix4d bind = Eigen::Matrix4d::Identity();
    bind.topRightCorner<3, 1>() = joint.position + style.placement[j];
    const Vector3d along = joint.tail - joint.position;
    if (style.frames != RigStyle::Frames::kWorld && along.norm() > 1e-9) {
      // frame_along puts the bone into the third column; a cyclic shift keeps the frame right-handed.
      const Matrix3d f = frame_along(along);
      const int shift = style.frames == RigStyle::Frames::kBoneAlongX ? 0 : 1;
      for (int axis = 0; axis < 3; ++axis) bind.block<3, 1>(0, (shift + axis) % 3) = f.col((2 + axis) % 3);
    }
    skeleton.bind.push_back(bind);
  }
  skeleton.rest = bind_pose(skeleton);
  return skeleton;
}

/// The body's swings as a loop of 1 to 2 s: keyed, linearly interpolated rotations.
Animation make_idle_animation(const Body& body, const Skeleton& skeleton, const RigStyle& style, Rng& rng) {
  Animation animation;
  animation.name = "idle";
  const double duration = rng.uniform(1.0, 2.0);
  const int steps = 8;
  std::map<int, std::vector<const Swing*>> by_joint;
  for (const Swing& swing : body.swings) by_joint[style.position[swing.joint]].push_back(&swing);
  for (const auto& [j, swings] : by_joint) {
    Channel channel;
    channel.joint = j;
    channel.path = ChannelPath::kRotation;
    const Matrix3d frame = skeleton.bind[j].topLeftCorner<3, 3>();
    const int parent = skeleton.parents[j];
    const Matrix3d above = parent < 0 ? Matrix3d::Identity() : Matrix3d(skeleton.bind[parent].topLeftCorner<3, 3>());
    for (int k = 0; k <= steps; ++k) {
      const double turn = 2.0 * kPi * (k % steps) / steps;
      Eigen::Quaterniond swung = Eigen::Quaterniond::Identity();
      for (const Swing* swing : swings) {
        const Vector3d axis = (body.joints[swing->joint].posed.linear() * swing->axis).normalized();
        swung = Eigen::Quaterniond(Eigen::AngleAxisd(swing->amplitude * std::sin(turn + swing->phase), axis)) * swung;
      }
      const Eigen::Quaterniond local =
          Eigen::Quaterniond(Matrix3d(above.transpose() * swung.toRotationMatrix() * frame)).normalized();
      channel.times.push_back(duration * k / steps);
      channel.values.insert(channel.values.end(), {local.x(), local.y(), local.z(), local.w()});
    }
    animation.channels.push_back(channel);
  }
  return animation;
}

struct Family {
  const char* name;
  void (*build)(Body&);
};

constexpr Family kFamilies[] = {
    {"biped", build_biped}, {"quadruped", build_quadruped}, {"bird", build_bird},           {"fish", build_fish},
    {"snake", build_snake}, {"spider", build_spider},       {"insect", build_insect},       {"dragon", build_dragon},
    {"plant", build_plant}, {"tree", build_tree},           {"robot_arm", build_robot_arm}, {"lamp", build_lamp},
    {"crab", build_crab},   {"octopus", build_octopus},     {"hand", build_hand},
};

constexpr std::size_t kFewestVertices = 2000, kMostVertices = 8000;

/// The surface with a vertex count near the one drawn: surface nets make about 1.5 vertices per spacing² of area.
Surface surface_of(const Body& body, double wanted) {
  double area = 0.0;
  for (const Primitive& p : body.primitives) area += p.carve ? 0.0 : surface_area(p);
  double spacing = std::sqrt(1.5 * 0.7 * area / wanted);
  spacing *= std::sqrt(estimate_vertices(body.primitives, spacing) / wanted);
  Surface best;
  for (int attempt = 0; attempt < 12; ++attempt) {
    Surface surface = extract_surface(body.primitives, spacing, body.machine ? 1 : 2);
    const auto count = static_cast<double>(surface.vertices.size());
    if (count == 0.0) {
      spacing *= 0.97;
      continue;
    }
    best = std::move(surface);
    if (count >= kFewestVertices && count <= kMostVertices) return best;
    spacing *= std::sqrt(count / std::clamp(wanted, 1.2 * kFewestVertices, 0.8 * kMostVertices));
  }
  return best;
}

/// Vertex colours: the paint of the primitive a vertex lies on, evaluated in the plan frame so that a bent limb keeps
/// its stripes.
std::vector<Eigen::Vector4f> colors_of(const Body& body, const Surface& surface, const SkinWeights& skin) {
  std::vector<Eigen::Vector4f> colors;
  for (std::size_t v = 0; v < surface.vertices.size(); ++v) {
    const Vector3d& x = surface.vertices[v];
    const Primitive& best = nearest_primitive(body, surface, v);
    Vector3d plan = Vector3d::Zero(), normal = Vector3d::Zero();
    for (std::size_t k = 0; k < skin.row_size(v); ++k) {
      const Influence& influence = skin.row(v)[k];
      const Eigen::Affine3d back = body.joints[influence.joint].posed.inverse(Eigen::Isometry);
      plan += influence.weight * (back * x);
      normal += influence.weight * (back.linear() * surface.normals[v]);
    }
    const Vector3d color = paint_color(body.paints[best.paint], plan, normal.normalized(), best.center, best.look);
    colors.emplace_back(static_cast<float>(color.x()), static_cast<float>(color.y()), static_cast<float>(color.z()),
                        1.0f);
  }
  return colors;
}

SkinWeights renumber(const SkinWeights& skin, const std::vector<int>& position) {
  SkinWeights result;
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    std::vector<Influence> row(skin.row(v), skin.row(v) + skin.row_size(v));
    for (Influence& influence : row) influence.joint = position[influence.joint];
    result.append_row(std::move(row));
  }
  return result;
}

Asset assemble(const Family& family, std::uint64_t seed, std::uint64_t index) {
  Body body(Rng(seed, std::string("creature/") + family.name, index));
  family.build(body);
  body.apply_pose();
  const double wanted = std::min(body.resolution * body.rng.uniform(3800.0, 6800.0), 7400.0);
  const Surface surface = surface_of(body, wanted);
  const SkinWeights skin = paint_weights(body, surface);
  const RigStyle style = random_style(body, body.rng);

  Asset asset;
  asset.name = std::string(family.name) + "_" + std::to_string(seed) + "_" + std::to_string(index);
  for (const Vector3d& x : surface.vertices) asset.mesh.vertices.push_back(x.cast<float>());
  for (const Vector3d& n : surface.normals) asset.mesh.normals.push_back(n.cast<float>());
  asset.mesh.faces = surface.faces;
  asset.mesh.colors = colors_of(body, surface, skin);
  asset.mesh.face_materials.assign(asset.mesh.faces.size(), 0);
  asset.skeleton = make_skeleton(body, style);
  asset.skin = renumber(skin, style.position);
  Material material;
  material.name = "default";
  material.double_sided = false;
  asset.materials.push_back(material);
  asset.animations.push_back(make_idle_animation(body, asset.skeleton, style, body.rng));
  normalize(asset);
  return asset;
}

}  // namespace

const std::vector<std::string>& creature_families() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> result;
    for (const Family& family : kFamilies) result.emplace_back(family.name);
    return result;
  }();
  return names;
}

const std::string& creature_family(std::uint64_t seed, std::uint64_t index) {
  return creature_families()[Rng(seed, "creature family", index).index(creature_families().size())];
}

Asset make_creature(std::uint64_t seed, std::uint64_t index) {
  return make_creature(creature_family(seed, index), seed, index);
}

Asset make_creature(const std::string& family, std::uint64_t seed, std::uint64_t index) {
  for (const Family& candidate : kFamilies) {
    if (family == candidate.name) return assemble(candidate, seed, index);
  }
  throw InputError("", "creature family",
                   "there is no family \"" + family + "\"; known are " + joined(kFamilies, ", ", &Family::name));
}

}  // namespace anigen::creatures
