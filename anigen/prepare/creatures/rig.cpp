#include "anigen/prepare/creatures/rig.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "anigen/core/numeric.h"

namespace anigen::prepare {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
constexpr double kPlacementError = 0.02;  // of the bone, per axis

}  // namespace

RigStyle random_style(const Body& body, Rng& rng) {
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

}  // namespace anigen::prepare
