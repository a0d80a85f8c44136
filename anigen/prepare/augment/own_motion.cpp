#include "anigen/prepare/augment/own_motion.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace anigen::prepare {
namespace {

constexpr std::size_t kTimes = 33;
constexpr std::size_t kVertices = 256;

using Points = std::vector<Eigen::Vector3d>;

// Some of the mesh's vertices, which can be posed quickly.
class Witnesses {
 public:
  explicit Witnesses(const Asset& asset) : asset_(&asset) {
    const std::size_t count = asset.mesh.vertices.size(), step = std::max<std::size_t>(1, count / kVertices);
    for (std::size_t v = 0; v < count && vertices_.size() < kVertices; v += step) vertices_.push_back(v);
    for (const Eigen::Matrix4d& bind : asset.skeleton.bind) from_bind_.push_back(bind.inverse());
  }

  // Positions in a pose, their mean subtracted: what moves as one does not count as movement.
  Points posed(const Pose& pose) const {
    std::vector<Eigen::Matrix4d> world = forward_kinematics(asset_->skeleton.parents, pose);
    for (std::size_t j = 0; j < world.size(); ++j) world[j] = world[j] * from_bind_[j];
    Points points;
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const std::size_t v : vertices_) {
      const Eigen::Vector4d vertex = asset_->mesh.vertices[v].cast<double>().homogeneous();
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (std::size_t i = 0; i < asset_->skin.row_size(v); ++i) {
        const Influence& influence = asset_->skin.row(v)[i];
        sum += static_cast<double>(influence.weight) *
               (world[static_cast<std::size_t>(influence.joint)] * vertex).head<3>();
      }
      points.push_back(sum);
      mean += sum;
    }
    mean /= static_cast<double>(points.size());
    for (Eigen::Vector3d& point : points) point -= mean;
    return points;
  }

 private:
  const Asset* asset_;
  std::vector<std::size_t> vertices_;
  std::vector<Eigen::Matrix4d> from_bind_;
};

double rms_distance(const Points& a, const Points& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(a.size()));
}

double longest_side(const Points& points) {
  Box box;
  for (const Eigen::Vector3d& point : points) box.extend(point);
  return box.longest_side();
}

double time_at(double begin, double end, std::size_t i) {
  return begin + (end - begin) * static_cast<double>(i) / static_cast<double>(kTimes - 1);
}

}  // namespace

std::string broken_keys(const Animation& animation, std::size_t joints) {
  if (animation.channels.empty()) return "it has no channels";
  for (const Channel& channel : animation.channels) {
    if (channel.joint < 0 || static_cast<std::size_t>(channel.joint) >= joints)
      return "it moves a joint that is missing";
    const std::size_t width = (channel.path == ChannelPath::kRotation ? 4u : 3u) *
                              (channel.interpolation == Interpolation::kCubicSpline ? 3u : 1u);
    if (channel.times.empty() || channel.values.size() != width * channel.times.size()) {
      return "a channel does not have one value per key";
    }
    for (std::size_t i = 0; i < channel.times.size(); ++i) {
      if (!std::isfinite(channel.times[i])) return "a key's time is not finite";
      if (i > 0 && !(channel.times[i] > channel.times[i - 1])) return "key times do not increase";
    }
    for (const double value : channel.values) {
      if (!std::isfinite(value)) return "a key is not finite";
    }
  }
  return "";
}

OwnMotion::OwnMotion(const Asset& asset, double least_motion) : asset_(&asset) {
  const Witnesses witnesses(asset);
  for (std::size_t c = 0; c < asset.animations.size(); ++c) {
    const Animation& animation = asset.animations[c];
    std::string problem = broken_keys(animation, asset.skeleton.size());
    Clip clip;
    clip.index = c;
    if (problem.empty()) {
      clip.begin = animation.channels.front().times.front();
      clip.end = clip.begin;
      for (const Channel& channel : animation.channels) {
        clip.begin = std::min(clip.begin, channel.times.front());
        clip.end = std::max(clip.end, channel.times.back());
      }
      std::vector<Points> poses;
      double size = 0.0;
      for (std::size_t i = 0; i < kTimes; ++i) {
        poses.push_back(witnesses.posed(sample(animation, asset.skeleton, time_at(clip.begin, clip.end, i))));
        size = std::max(size, longest_side(poses.back()));
      }
      // A clip whose poses have no extent moves nothing.
      const double unit = size > 0.0 ? 1.0 / size : 0.0;
      double range = 0.0;
      for (std::size_t i = 0; i < kTimes; ++i) {
        clip.way.push_back(i == 0 ? 0.0 : clip.way.back() + unit * rms_distance(poses[i - 1], poses[i]));
        range = std::max(range, unit * rms_distance(poses.front(), poses[i]));
      }
      if (!std::isfinite(clip.way.back()) || !std::isfinite(range)) {
        problem = "it moves vertices out of all bounds";
      } else if (!(clip.end > clip.begin)) {
        problem = "it has no length";
      } else if (!(range >= least_motion) || !(clip.way.back() > 0.0)) {
        problem = "it does not move the mesh";
      }
    }
    if (problem.empty()) {
      total_way_ += clip.way.back();
      clips_.push_back(std::move(clip));
    } else {
      unused_.push_back(animation.name + ": " + problem);
    }
  }
}

const OwnMotion::Clip& OwnMotion::clip_of(std::size_t index) const {
  return *std::find_if(clips_.begin(), clips_.end(), [&](const Clip& clip) { return clip.index == index; });
}

MotionPose OwnMotion::at(double place) const {
  double target = std::clamp(place, 0.0, 1.0) * total_way_;
  std::size_t chosen = 0;
  while (chosen + 1 < clips_.size() && target >= clips_[chosen].way.back()) target -= clips_[chosen++].way.back();
  const Clip& clip = clips_[chosen];
  target = std::min(target, clip.way.back());
  // The first sampled time beyond the target, so that a pause before it is skipped.
  std::size_t after = 1;
  while (after + 1 < kTimes && clip.way[after] <= target) ++after;
  const double step = clip.way[after] - clip.way[after - 1];
  const double s = step > 0.0 ? std::clamp((target - clip.way[after - 1]) / step, 0.0, 1.0) : 0.0;
  MotionPose result;
  result.clip = clip.index;
  const double from = time_at(clip.begin, clip.end, after - 1), to = time_at(clip.begin, clip.end, after);
  result.time = result.second_time = from + s * (to - from);
  result.pose = sample(asset_->animations[clip.index], asset_->skeleton, result.time);
  return result;
}

MotionPose OwnMotion::blended(const MotionPose& first, Rng& rng) const {
  const Clip& clip = clip_of(first.clip);
  MotionPose result = first;
  result.second_time = rng.uniform(clip.begin, clip.end);
  result.blend = rng.uniform(0.0, 0.5);
  const Pose second = sample(asset_->animations[clip.index], asset_->skeleton, result.second_time);
  for (std::size_t j = 0; j < second.size(); ++j) {
    Transform& joint = result.pose[j];
    joint.translation += result.blend * (second[j].translation - joint.translation);
    joint.scale += result.blend * (second[j].scale - joint.scale);
    joint.rotation = joint.rotation.slerp(result.blend, second[j].rotation).normalized();
  }
  return result;
}

}  // namespace anigen::prepare
