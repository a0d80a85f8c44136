#include "anigen/motions/poser.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::motions {

namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

/// Bend of a chain at one joint: flexing turns what follows about the axis.
struct Bend {
  Vector3d axis;
  double angle;     // in the bind pose
  double per_unit;  // added per unit of flexion
};

std::vector<Vector3d> leg_points(const Body& body, const Limb& leg) {
  std::vector<Vector3d> points;
  for (std::size_t i = leg.hip; i <= leg.ankle; ++i) points.push_back(body.figure.tree.positions[at(leg.joints[i])]);
  if (points.size() == 1) points.push_back(leg.contact);  // of one piece: its foot is its end
  return points;
}

/// Bends at the joints between hip and ankle. A straight leg bends at its knee alone, forwards.
std::vector<Bend> bends_of(const Body& body, const Limb& leg, const std::vector<Vector3d>& points) {
  std::vector<Bend> bends;
  double most = 0.0;
  for (std::size_t i = 1; i + 1 < points.size(); ++i) {
    const Vector3d before = points[i] - points[i - 1], after = points[i + 1] - points[i];
    const Vector3d normal = before.cross(after);
    Bend bend{body.figure.left, 0.0, 0.0};
    if (normal.norm() > 1e-9 * before.norm() * after.norm() && before.norm() > 0.0 && after.norm() > 0.0) {
      bend.axis = normal.normalized();
      bend.angle = std::atan2(normal.norm(), before.dot(after));
    }
    bend.per_unit = bend.angle;
    most = std::max(most, bend.angle);
    bends.push_back(bend);
  }
  constexpr double kStraight = 12.0 * kPi / 180.0;
  if (most < kStraight && leg.knee > leg.hip) {
    Bend& knee = bends[leg.knee - leg.hip - 1];
    const Vector3d forward = body.figure.forward;
    const Vector3d way = points.back() - points.front();
    // Turning the shin about this axis takes the ankle backwards, the knee points forwards.
    const Vector3d axis = forward.cross(way).normalized();
    if (axis.allFinite() && axis.norm() > 0.5) {
      for (Bend& bend : bends) bend.per_unit = bend.angle;
      const double along = knee.axis.dot(axis) * knee.angle;
      knee.axis = axis;
      knee.angle = along;
      knee.per_unit = 0.5;
    }
  }
  return bends;
}

/// The chain from its first point, bent by `flexion` (0: as in the bind pose, -1: straight where bends are the bind
/// pose's). @param turns gets the turn of each bone
Vector3d bent_end(const std::vector<Vector3d>& points, const std::vector<Bend>& bends, double flexion,
                  std::vector<Quaterniond>* turns) {
  Quaterniond turn = Quaterniond::Identity();
  Vector3d end = Vector3d::Zero();
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    if (i > 0) turn = turn * Quaterniond(AngleAxisd(flexion * bends[i - 1].per_unit, bends[i - 1].axis));
    if (turns != nullptr) turns->push_back(turn);
    end += turn * (points[i + 1] - points[i]);
  }
  return end;
}

/// Flexion at which the ends are `distance` apart, as near as it gets.
double flexion_for(const std::vector<Vector3d>& points, const std::vector<Bend>& bends, double distance) {
  if (bends.empty()) return 0.0;
  double most = 0.0, largest = 0.0;
  for (const Bend& bend : bends) {
    most = std::max(most, bend.per_unit);
    largest = std::max(largest, bend.angle);
  }
  if (!(most > 0.0)) return 0.0;
  const bool by_knee =
      std::any_of(bends.begin(), bends.end(), [](const Bend& bend) { return bend.per_unit > bend.angle + 1e-12; });
  double low = by_knee ? -std::max(0.0, largest) / most : -1.0;
  double high = std::max(low, (150.0 * kPi / 180.0 - largest) / most);
  for (int step = 0; step < 50; ++step) {
    const double middle = 0.5 * (low + high);
    (bent_end(points, bends, middle, nullptr).norm() > distance ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

double length_of(const std::vector<double>& a, const std::vector<double>& b, std::size_t first, std::size_t width) {
  double largest = 0.0;
  for (std::size_t i = 0; i < width; ++i) largest = std::max(largest, std::abs(a[first + i] - b[i]));
  return largest;
}

void drop_constant(Channel& channel, const Transform& rest, double size, bool& unneeded) {
  if (channel.interpolation == Interpolation::kCubicSpline || channel.times.empty()) return;
  const std::size_t width = channel.path == ChannelPath::kRotation ? 4 : 3;
  const double noise = channel.path == ChannelPath::kTranslation ? 1e-7 * size : 1e-7;
  const std::vector<double> first(channel.values.begin(), channel.values.begin() + static_cast<std::ptrdiff_t>(width));
  for (std::size_t k = 1; k < channel.times.size(); ++k) {
    if (length_of(channel.values, first, k * width, width) > noise) return;
  }
  channel.times.resize(1);
  channel.values.resize(width);
  if (channel.path == ChannelPath::kTranslation)
    unneeded = (Vector3d(first[0], first[1], first[2]) - rest.translation).norm() < 1e-6 * size;
}

}  // namespace

Poser::Poser(const Body& body) : body_(body), turns_(body.figure.joints(), Quaterniond::Identity()) {}

void Poser::turn(int joint, const Quaterniond& by) { turns_[at(joint)] = (by * turns_[at(joint)]).normalized(); }

void Poser::turn(int joint, const Vector3d& axis, double degrees) {
  turn(joint, Quaterniond(AngleAxisd(degrees * kPi / 180.0, axis)));
}

Quaterniond Poser::world_turn(int joint) const {
  Quaterniond result = turns_[at(joint)];
  for (int j = body_.figure.tree.parents[at(joint)]; j >= 0; j = body_.figure.tree.parents[at(j)])
    result = turns_[at(j)] * result;
  return result.normalized();
}

JointMotions Poser::motions() const {
  const Figure& figure = body_.figure;
  std::vector<Quaterniond> world(figure.joints());
  JointMotions result(figure.joints());
  for (const int j : figure.order) {
    const int parent = figure.tree.parents[at(j)];
    const Vector3d& here = figure.tree.positions[at(j)];
    world[at(j)] = parent < 0 ? turns_[at(j)] : (world[at(parent)] * turns_[at(j)]).normalized();
    const Vector3d place = parent < 0 ? Vector3d(here + shift_) : result[at(parent)](here);
    result[at(j)].turn = world[at(j)].toRotationMatrix();
    result[at(j)].shift = place - result[at(j)].turn * here;
  }
  return result;
}

void Poser::place_foot(const Limb& leg, const Vector3d& ankle, const Quaterniond& foot) {
  const int hip = leg.joints[leg.hip];
  const std::vector<Vector3d> points = leg_points(body_, leg);
  turns_[at(hip)] = Quaterniond::Identity();
  const int above = body_.figure.tree.parents[at(hip)];
  const Vector3d from = motions()[at(hip)](bind(hip));
  Vector3d way = ankle - from;
  const double distance = way.norm();
  const std::vector<Bend> bends = bends_of(body_, leg, points);
  if (bends.empty()) {
    // One bone: it turns until its end is right along the ground, whatever that does to its height.
    const double length = (points[1] - points[0]).norm();
    const double level = std::min(std::hypot(way.x(), way.y()), 0.99 * length);
    const double scale = std::hypot(way.x(), way.y()) > 0.0 ? level / std::hypot(way.x(), way.y()) : 0.0;
    way = Vector3d(scale * way.x(), scale * way.y(),
                   (way.z() > 0.0 ? 1.0 : -1.0) * std::sqrt(length * length - level * level));
  }
  std::vector<Quaterniond> bones;
  const Vector3d end = bent_end(points, bends, flexion_for(points, bends, distance), &bones);
  const Quaterniond aim = Quaterniond::FromTwoVectors(end, way);
  const Quaterniond carried = above < 0 ? Quaterniond::Identity() : world_turn(above);
  Quaterniond before = carried;
  for (std::size_t i = leg.hip; i < leg.ankle; ++i) {
    const Quaterniond wanted = (aim * bones[i - leg.hip]).normalized();
    turns_[at(leg.joints[i])] = (before.conjugate() * wanted).normalized();
    before = wanted;
  }
  if (leg.ankle == leg.hip) {
    turns_[at(hip)] = (carried.conjugate() * aim).normalized();
  } else {
    turns_[at(leg.joints[leg.ankle])] = (before.conjugate() * foot).normalized();
  }
}

void Poser::set(const JointMotions& pose) {
  for (std::size_t j = 0; j < turns_.size(); ++j) {
    const int parent = body_.figure.tree.parents[j];
    const Quaterniond own(pose[j].turn);
    turns_[j] = parent < 0 ? own : Quaterniond(pose[at(parent)].turn).conjugate() * own;
    turns_[j].normalize();
    if (parent < 0) shift_ = pose[j](bind(static_cast<int>(j))) - bind(static_cast<int>(j));
  }
}

void Poser::move_foot(const Limb& leg, const Vector3d& ankle) {
  const int hip = leg.joints[leg.hip], knee = leg.joints[leg.knee];
  const Quaterniond foot = world_turn(leg.joints[leg.ankle]);
  const auto aside = [&](const JointMotions& pose) {
    const Vector3d from = pose[at(hip)](bind(hip)), way = (ankle - from).normalized();
    const Vector3d bent = pose[at(knee)](bind(knee)) - from;
    return Vector3d(bent - bent.dot(way) * way);
  };
  const Vector3d before = aside(motions());
  place_foot(leg, ankle, foot);
  const JointMotions placed = motions();
  const Vector3d now = aside(placed), way = (ankle - placed[at(hip)](bind(hip))).normalized();
  const double length = reach_of(body_, leg);
  if (before.norm() < 0.02 * length || now.norm() < 0.02 * length) return;  // nearly straight: no direction
  const double angle = std::atan2(now.cross(before).dot(way), now.dot(before));
  const int above = body_.figure.tree.parents[at(hip)];
  const Quaterniond carried = above < 0 ? Quaterniond::Identity() : world_turn(above);
  turns_[at(hip)] =
      (carried.conjugate() * Quaterniond(AngleAxisd(angle, way)) * carried * turns_[at(hip)]).normalized();
  const int end = leg.joints[leg.ankle], shin = body_.figure.tree.parents[at(end)];
  turns_[at(end)] = (world_turn(shin).conjugate() * foot).normalized();
}

double reach_of(const Body& body, const Limb& leg) {
  const std::vector<Vector3d> points = leg_points(body, leg);
  double length = 0.0;
  for (std::size_t i = 1; i < points.size(); ++i) length += (points[i] - points[i - 1]).norm();
  return length;
}

Animation without_constants(Animation animation, const Skeleton& skeleton) {
  Box box;
  for (const Vector3d& p : skeleton.positions()) box.extend(p);
  const double size = std::max(box.diagonal(), 1e-12);
  std::vector<Channel> kept;
  for (Channel& channel : animation.channels) {
    bool unneeded = false;
    drop_constant(channel, skeleton.rest[at(channel.joint)], size, unneeded);
    if (!unneeded) kept.push_back(std::move(channel));
  }
  animation.channels = std::move(kept);
  return animation;
}

Animation to_clip(const std::string& name, const std::vector<double>& times, const std::vector<JointMotions>& poses,
                  const Skeleton& skeleton) {
  const std::size_t count = skeleton.size();
  const std::vector<Vector3d> positions = skeleton.positions();
  std::vector<std::vector<double>> rotations(count), translations(count), scales(count);
  std::vector<bool> rescaled(count, false);
  std::vector<Quaterniond> last(count, Quaterniond::Identity());
  for (const JointMotions& motions : poses) {
    if (motions.size() != count) throw InputError("", "poses", "do not have one motion per joint");
    std::vector<Eigen::Matrix4d> world(skeleton.bind);
    for (std::size_t j = 0; j < count; ++j) {
      if (!motions[j].turn.allFinite() || !motions[j].shift.allFinite())
        throw InputError("", "poses", "joint " + skeleton.names[j] + " is not finite");
      world[j].topLeftCorner<3, 3>() = motions[j].turn * skeleton.bind[j].topLeftCorner<3, 3>();
      world[j].topRightCorner<3, 1>() = motions[j](positions[j]);
    }
    const Pose pose = local_pose(skeleton.parents, world);
    for (std::size_t j = 0; j < count; ++j) {
      Quaterniond q = pose[j].rotation.normalized();
      if (q.dot(last[j]) < 0.0) q.coeffs() = -q.coeffs();
      last[j] = q;
      const Vector3d &t = pose[j].translation, &s = pose[j].scale;
      rotations[j].insert(rotations[j].end(), {q.x(), q.y(), q.z(), q.w()});
      translations[j].insert(translations[j].end(), {t.x(), t.y(), t.z()});
      scales[j].insert(scales[j].end(), {s.x(), s.y(), s.z()});
      if ((s - skeleton.rest[j].scale).cwiseAbs().maxCoeff() > 1e-6) rescaled[j] = true;
    }
  }
  Animation animation;
  animation.name = name;
  for (std::size_t j = 0; j < count; ++j) {
    const auto add = [&](ChannelPath path, std::vector<double>& values) {
      animation.channels.push_back({static_cast<int>(j), path, Interpolation::kLinear, times, std::move(values)});
    };
    add(ChannelPath::kRotation, rotations[j]);
    add(ChannelPath::kTranslation, translations[j]);
    if (rescaled[j]) add(ChannelPath::kScale, scales[j]);
  }
  return without_constants(std::move(animation), skeleton);
}

}  // namespace anigen::motions
