#include "anigen/tracking/track.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/process.h"
#include "anigen/io/image_resize.h"
#include "anigen/motions/poser.h"

namespace anigen::tracking {

namespace {

constexpr double kFade = 0.1;          // of the optimiser's step, at the end of a level
constexpr double kCropMargin = 1.3;    // of a frame's part, over its silhouette
constexpr double kExtrapolated = 0.5;  // of the last change, at the start of the next frame
constexpr double kDistanceFade = 0.3;  // of the distance terms' weight, from level to level
constexpr int kRigidIterations = 30;
constexpr int kLightEvery = 15;  // iterations between fits of the light
constexpr std::int64_t kLeastLevel = 32;

struct Level {
  std::vector<FrameLevel> frames;
};

std::vector<std::int64_t> sizes_of(std::int64_t resolution) {
  std::vector<std::int64_t> sizes{resolution};
  while (sizes.front() / 2 >= kLeastLevel && sizes.size() < 3) sizes.insert(sizes.begin(), sizes.front() / 2);
  return sizes;
}

/// Adam (Kingma and Ba 2015) whose second moment is that of a joint's whole vector (Ling et al. 2022, "VectorAdam"):
/// its three numbers are no axes of their own, and what hardly shows, such as a turn about the bone, is not blown up
/// to the size of the rest. For the same reason joints with far smaller slopes than the largest take smaller steps.
class VectorAdam {
 public:
  explicit VectorAdam(const Tensor& value)
      : mean_(torch::zeros_like(value)), square_(torch::zeros_like(value.narrow(-1, 0, 1))) {}

  /// @param value, gradient [N, J, 3] or [N, 3]; each of N has its own scale
  void step(Tensor& value, const Tensor& gradient, double rate) {
    const torch::NoGradGuard no_grad;
    ++count_;
    mean_.mul_(kMean).add_(gradient, 1.0 - kMean);
    square_.mul_(kSquare).add_(gradient.square().sum(-1, true), 1.0 - kSquare);
    const Tensor slope = (square_ / (1.0 - std::pow(kSquare, count_))).sqrt();
    const Tensor least = value.dim() == 3 ? kLeastShare * slope.amax(1, true) : torch::zeros_like(slope);
    value.sub_(rate / (1.0 - std::pow(kMean, count_)) * mean_ / (slope + least + 1e-12));
  }

 private:
  static constexpr double kMean = 0.9, kSquare = 0.98, kLeastShare = 0.05;
  Tensor mean_, square_;
  int count_ = 0;
};

/// The part of a frame around its silhouette, so that the coarse levels, too, show limbs.
TrackedFrame around_silhouette(const TrackedFrame& frame) {
  const io::Image& image = frame.image;
  if (image.width != image.height) throw InputError(frame.name, "", "a frame to track in is square");
  int x0 = image.width, x1 = 0, y0 = image.height, y1 = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      if (image.pixel(x, y)[3] < 128) continue;
      x0 = std::min(x0, x);
      x1 = std::max(x1, x + 1);
      y0 = std::min(y0, y);
      y1 = std::max(y1, y + 1);
    }
  }
  if (x0 >= x1) throw InputError(frame.name, "", "nothing in it is visible: there is no object to follow");
  const int side = std::max(8, static_cast<int>(std::lround(kCropMargin * std::max(x1 - x0, y1 - y0))));
  io::PixelBox box;
  box.x0 = (x0 + x1 - side) / 2;
  box.y0 = (y0 + y1 - side) / 2;
  box.x1 = box.x0 + side;
  box.y1 = box.y0 + side;
  TrackedFrame part{io::crop(image, box), frame.name, frame.camera};
  const double share = static_cast<double>(side) / image.width;
  part.camera.focal_x /= share;
  part.camera.focal_y /= share;
  part.camera.center_x = (part.camera.center_x - static_cast<double>(box.x0) / image.width) / share;
  part.camera.center_y = (part.camera.center_y - static_cast<double>(box.y0) / image.height) / share;
  return part;
}

class Tracker {
 public:
  Tracker(const RigTensors& rig, const std::vector<TrackedFrame>& frames, const TrackOptions& options)
      : rig_(rig), options_(options) {
    for (const TrackedFrame& frame : frames) frames_.push_back(around_silhouette(frame));
    for (const std::int64_t size : sizes_of(options.resolution)) {
      Level level;
      for (const TrackedFrame& frame : frames_) level.frames.push_back(frame_level(frame.image, size, frame.name));
      levels_.push_back(std::move(level));
    }
    const Tensor low = rig.vertices.amin(0), high = rig.vertices.amax(0);
    size_ = (high - low).max().item<double>();
    const auto count = static_cast<std::int64_t>(frames.size());
    turns_ = torch::zeros({count, rig.joints(), 3}, torch::kFloat64);
    shifts_ = torch::zeros({count, 3}, torch::kFloat64);
    lights_.resize(frames.size(), plain_light());
    require_in_view();
  }

  void solve_frame(std::size_t t) {
    const auto n = static_cast<std::int64_t>(t);
    Tensor turns = torch::zeros({1, rig_.joints(), 3}, torch::kFloat64), shift = torch::zeros({1, 3}, torch::kFloat64);
    if (t > 0) {
      turns.copy_(turns_.narrow(0, n - 1, 1));
      shift.copy_(shifts_.narrow(0, n - 1, 1));
      lights_[t] = lights_[t - 1];
    }
    if (t == 0) begin(turns, shift);
    const Tensor before = turns.clone(), shift_before = shift.clone();
    if (t > 1) {  // on as it went, though not all the way
      turns.add_(turns_.narrow(0, n - 1, 1) - turns_.narrow(0, n - 2, 1), kExtrapolated);
      shift.add_(shifts_.narrow(0, n - 1, 1) - shifts_.narrow(0, n - 2, 1), kExtrapolated);
    }
    for (std::size_t level = 0; level < levels_.size(); ++level) {
      const FrameLevel& frame = levels_[level].frames[t];
      const int iterations = t == 0 ? options_.first_iterations : options_.iterations;
      ObjectiveWeights weights = options_.weights;
      // Lost overlap is found again at the coarse levels; at the finest the pictures themselves say more.
      weights.distance *= std::pow(kDistanceFade, static_cast<double>(level));
      const double rate = options_.rate * std::pow(0.6, static_cast<double>(level));
      VectorAdam turn_steps(turns), shift_steps(shift);
      for (int i = 0; i < iterations; ++i) {
        throw_if_interrupted();
        if (i % kLightEvery == 0) fit_light_of(t, turns, shift, frame);
        const Tensor x = turns.clone().requires_grad_(), s = shift.clone().requires_grad_();
        const PosedRig pose = posed(rig_, x, s);
        Tensor energy =
            picture_energy(rig_, pose.vertices[0], pose.normals[0], frames_[t].camera, frame, lights_[t], weights) +
            pose_energy(rig_, x, weights);
        if (t > 0) energy = energy + change_energy(rig_, x, before, s, shift_before, size_, weights.step);
        energy.backward();
        const double fade = std::pow(kFade, static_cast<double>(i) / iterations);
        turn_steps.step(turns, x.grad() * rig_.is_free, rate * fade);
        shift_steps.step(shift, s.grad(), 0.25 * rate * fade * size_);
      }
    }
    turns_.narrow(0, n, 1).copy_(turns);
    shifts_.narrow(0, n, 1).copy_(shift);
  }

  /// The first frame: the rig as a whole moves to the silhouette.
  void begin(Tensor& turns, Tensor& shift) {
    const FrameLevel& frame = levels_.front().frames.front();
    VectorAdam turn_steps(turns), shift_steps(shift);
    Tensor root = torch::zeros_like(rig_.is_free);
    root[0].fill_(1.0);
    for (int i = 0; i < kRigidIterations; ++i) {
      const Tensor x = turns.clone().requires_grad_(), s = shift.clone().requires_grad_();
      const PosedRig pose = posed(rig_, x, s);
      picture_energy(rig_, pose.vertices[0], pose.normals[0], frames_.front().camera, frame, lights_.front(),
                     options_.weights)
          .backward();
      const double fade = std::pow(kFade, static_cast<double>(i) / kRigidIterations);
      turn_steps.step(turns, x.grad() * root, 0.5 * options_.rate * fade);
      shift_steps.step(shift, s.grad(), 0.25 * options_.rate * fade * size_);
    }
  }

  /// One pass of gradients over all frames at once.
  void solve_together(const std::function<void()>& done) {
    const auto count = static_cast<std::int64_t>(frames_.size());
    VectorAdam turn_steps(turns_), shift_steps(shifts_);
    const Level& level = levels_.back();
    ObjectiveWeights weights = options_.weights;
    weights.distance *= std::pow(kDistanceFade, static_cast<double>(levels_.size() - 1));
    for (int i = 0; i < options_.joint_iterations; ++i) {
      throw_if_interrupted();
      const Tensor x = turns_.clone().requires_grad_(), s = shifts_.clone().requires_grad_();
      const PosedRig pose = posed(rig_, x, s);
      // Pictures one by one, so that one rendering at a time is kept; their gradients meet at the vertices.
      const Tensor vertices = pose.vertices.detach().clone().requires_grad_();
      for (std::int64_t n = 0; n < count; ++n) {
        const auto t = static_cast<std::size_t>(n);
        if (i % kLightEvery == 0) fit_light_of(t, turns_.narrow(0, n, 1), shifts_.narrow(0, n, 1), level.frames[t]);
        (picture_energy(rig_, vertices[n], pose.normals[n], frames_[t].camera, level.frames[t], lights_[t], weights) /
         static_cast<double>(count))
            .backward();
      }
      Tensor smooth = pose_energy(rig_, x, weights);
      if (count > 1) smooth = smooth + change(x, s, weights.step);
      if (count > 2) smooth = smooth + bend(x, s, weights.bend);
      torch::autograd::backward({pose.vertices, smooth}, {vertices.grad(), Tensor()});
      const double fade = std::pow(kFade, static_cast<double>(i) / options_.joint_iterations);
      turn_steps.step(turns_, x.grad() * rig_.is_free, 0.3 * options_.rate * fade);
      shift_steps.step(shifts_, s.grad(), 0.1 * options_.rate * fade * size_);
      if (done) done();
    }
  }

  TrackedPoses result() const {
    const torch::NoGradGuard no_grad;
    TrackedPoses poses{turns_, shifts_, {}, lights_, 0.0};
    const PosedRig pose = posed(rig_, turns_, shifts_);
    for (std::size_t t = 0; t < frames_.size(); ++t) {
      const auto n = static_cast<std::int64_t>(t);
      const Tensor clip = clip_positions(pose.vertices[n], frames_[t].camera);
      const FrameLevel& frame = levels_.back().frames[t];
      poses.overlaps.push_back(
          overlap_of(render_rig(rig_, clip, pose.normals[n], lights_[t], frame.size()).mask, frame.alpha));
    }
    return poses;
  }

 private:
  void fit_light_of(std::size_t t, const Tensor& turns, const Tensor& shift, const FrameLevel& frame) {
    const torch::NoGradGuard no_grad;
    const PosedRig pose = posed(rig_, turns, shift);
    lights_[t] = fit_light(rig_, clip_positions(pose.vertices[0], frames_[t].camera), pose.normals[0], frame);
  }

  Tensor change(const Tensor& x, const Tensor& s, double weight) const {
    const std::int64_t steps = x.size(0) - 1;
    return change_energy(rig_, x.narrow(0, 1, steps), x.narrow(0, 0, steps), s.narrow(0, 1, steps),
                         s.narrow(0, 0, steps), size_, weight);
  }

  Tensor bend(const Tensor& x, const Tensor& s, double weight) const {
    const std::int64_t steps = x.size(0) - 2;
    return change_energy(rig_, x.narrow(0, 2, steps) + x.narrow(0, 0, steps), 2.0 * x.narrow(0, 1, steps),
                         s.narrow(0, 2, steps) + s.narrow(0, 0, steps), 2.0 * s.narrow(0, 1, steps), size_, weight);
  }

  void require_in_view() const {
    const torch::NoGradGuard no_grad;
    const PosedRig bind = posed(rig_, turns_.narrow(0, 0, 1), shifts_.narrow(0, 0, 1));
    for (const TrackedFrame& frame : frames_) {
      const Tensor depth = clip_positions(bind.vertices[0], frame.camera).select(1, 3);
      if ((depth > 0.0).all().item<bool>()) continue;
      throw InputError(frame.name, "camera", "stands inside the rig or looks away from it");
    }
  }

  const RigTensors& rig_;
  std::vector<TrackedFrame> frames_;
  const TrackOptions& options_;
  std::vector<Level> levels_;  // coarse to fine
  double size_ = 1.0;
  Tensor turns_, shifts_;
  std::vector<Light> lights_;
};

void check_track_options(const TrackOptions& options) {
  require_between(static_cast<double>(options.resolution), 32, 1024, "resolution");
  require_between(options.first_iterations, 1, 10'000, "first_iterations");
  require_between(options.iterations, 1, 10'000, "iterations");
  require_between(options.joint_iterations, 0, 10'000, "joint_iterations");
  require_between(options.rate, 1e-6, 1.0, "rate");
}

}  // namespace

TrackedPoses track(const RigTensors& rig, const std::vector<TrackedFrame>& frames, const TrackOptions& options,
                   const std::function<void()>& done) {
  check_track_options(options);
  if (frames.empty()) throw InputError("", "frames", "there is no frame to track the rig in");
  const auto started = std::chrono::steady_clock::now();
  Tracker tracker(rig, frames, options);
  for (std::size_t t = 0; t < frames.size(); ++t) {
    tracker.solve_frame(t);
    if (done) done();
  }
  tracker.solve_together(done);
  TrackedPoses poses = tracker.result();
  poses.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return poses;
}

std::size_t track_steps(std::size_t frames, const TrackOptions& options) {
  return frames + static_cast<std::size_t>(options.joint_iterations);
}

Animation clip_of(const TrackedPoses& poses, const Skeleton& skeleton, const Similarity& normalisation, double fps,
                  const std::string& name) {
  require_between(fps, 1.0, 240.0, "frames per second");
  const std::int64_t frames = poses.turns.size(0), joints = poses.turns.size(1);
  const Pose bind = bind_pose(skeleton);
  Animation clip;
  clip.name = name;
  std::vector<double> times;
  for (std::int64_t n = 0; n < frames; ++n) times.push_back(static_cast<double>(n) / fps);
  const Tensor turns = poses.turns.contiguous(), shifts = poses.shifts.contiguous();
  for (std::int64_t j = 0; j < joints; ++j) {
    Channel channel{static_cast<int>(j), ChannelPath::kRotation, Interpolation::kLinear, times, {}};
    for (std::int64_t n = 0; n < frames; ++n) {
      const Eigen::Map<const Eigen::Vector3d> turn(turns.data_ptr<double>() + 3 * (n * joints + j));
      const double angle = turn.norm();
      const Eigen::Vector3d axis = angle > 0.0 ? Eigen::Vector3d(turn / angle) : Eigen::Vector3d::UnitX();
      const Eigen::Quaterniond rotation =
          bind[static_cast<std::size_t>(j)].rotation * Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis));
      for (const double number : {rotation.x(), rotation.y(), rotation.z(), rotation.w()})
        channel.values.push_back(number);
    }
    clip.channels.push_back(std::move(channel));
    // A clip starts from the rest pose, which need not be the bind pose.
    const Transform& local = bind[static_cast<std::size_t>(j)];
    const auto constant = [&](ChannelPath path, const Eigen::Vector3d& value) {
      clip.channels.push_back(
          {static_cast<int>(j), path, Interpolation::kLinear, {0.0}, {value.x(), value.y(), value.z()}});
    };
    if (j > 0) constant(ChannelPath::kTranslation, local.translation);
    if ((local.scale - skeleton.rest[static_cast<std::size_t>(j)].scale).cwiseAbs().maxCoeff() > 1e-6)
      constant(ChannelPath::kScale, local.scale);
  }
  Channel channel{0, ChannelPath::kTranslation, Interpolation::kLinear, times, {}};
  for (std::int64_t n = 0; n < frames; ++n) {
    for (Eigen::Index k = 0; k < 3; ++k) {
      channel.values.push_back(bind.front().translation[k] +
                               shifts.data_ptr<double>()[3 * n + k] / normalisation.scale);
    }
  }
  clip.channels.push_back(std::move(channel));
  return motions::without_constants(std::move(clip), skeleton);
}

}  // namespace anigen::tracking
