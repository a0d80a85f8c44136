#include "anigen/tracking/track.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/render/dataset_views.h"
#include "tests/tracking/bent_chain.h"

namespace anigen::tracking {
namespace {

constexpr double kRadian = 3.14159265358979323846 / 180.0;

render::Frame front_frame(double yaw_degrees) {
  render::ViewCamera view;
  view.yaw = (yaw_degrees - 90.0) * kRadian;
  view.pitch = 0.1;
  view.radius = 2.6;
  view.fov = render::kFeatureFov;
  return render::make_frame(view, "000.png");
}

// The bar bent by an angle about y, which a camera on −y sees from the side, as the ray tracer renders it.
TrackedFrame bent_frame(const Asset& bar, double degrees) {
  Pose pose = bind_pose(bar.skeleton);
  pose[1].rotation = Eigen::AngleAxisd(degrees * kRadian, Eigen::Vector3d::UnitY());
  const render::Scene scene(bar, skin_vertices(bar, pose));
  render::ViewOptions options;
  options.size = 160;
  const render::Frame frame = front_frame(15.0);
  return {render::render_view(scene, frame, options).color, std::to_string(degrees), pinhole(frame)};
}

TrackOptions quick() {
  TrackOptions options;
  options.resolution = 96;
  options.first_iterations = 60;
  options.iterations = 30;
  options.joint_iterations = 15;
  return options;
}

TEST(Tracking, RecoversTheBendOfAChain) {
  const Asset bar = test::two_bone_bar();
  const RigTensors rig = rig_tensors(bar);
  std::vector<TrackedFrame> frames;
  const std::vector<double> truth = {20.0, 32.0, 45.0, 60.0};
  for (const double degrees : truth) frames.push_back(bent_frame(bar, degrees));
  std::size_t steps = 0;
  const TrackOptions options = quick();
  const TrackedPoses poses = track(rig, frames, options, [&] { ++steps; });
  EXPECT_EQ(steps, track_steps(frames.size(), options));
  const Animation clip = clip_of(poses, bar.skeleton, {}, 10.0, "bend");
  for (std::size_t t = 0; t < truth.size(); ++t) {
    EXPECT_GT(poses.overlaps[t], 0.93) << t;
    const Pose pose = sample(clip, bar.skeleton, static_cast<double>(t) / 10.0);
    const Eigen::Quaterniond wanted(Eigen::AngleAxisd(truth[t] * kRadian, Eigen::Vector3d::UnitY()));
    const double bend = pose[1].rotation.angularDistance(Eigen::Quaterniond::Identity()) / kRadian;
    EXPECT_NEAR(bend, truth[t], 5.0) << t;
    // The bar as a whole may turn a little about its length, which hardly shows, and the axis of the bend with it.
    EXPECT_LT(pose[1].rotation.angularDistance(wanted) / kRadian, 12.0) << t;
  }
}

TEST(Tracking, ClipIsInTheAssetsOwnFrame) {
  Asset bar = test::two_bone_bar();
  const Similarity grown{20.0, {3.0, 4.0, 5.0}};
  apply(grown, bar);
  const Asset original = bar;
  const Similarity normalisation = normalize(bar);
  TrackedPoses poses;
  poses.turns = torch::zeros({2, 2, 3}, torch::kFloat64);
  poses.shifts = torch::zeros({2, 3}, torch::kFloat64);
  poses.turns[1][1][1].fill_(0.3);
  poses.shifts[1][0].fill_(0.1);
  const Animation clip = clip_of(poses, original.skeleton, normalisation, 2.0, "moved");
  const Pose pose = sample(clip, original.skeleton, 0.5);
  EXPECT_NEAR(pose[1].rotation.angularDistance(Eigen::Quaterniond::Identity()), 0.3, 1e-9);
  EXPECT_NEAR(pose[0].translation.x() - original.skeleton.rest[0].translation.x(), 2.0, 1e-6);
  // Vertices of the clip are those of posed(), moved back.
  const RigTensors rig = rig_tensors(bar);
  const Tensor here = posed(rig, poses.turns, poses.shifts).vertices[1];
  const std::vector<Eigen::Vector3f> there = skin_vertices(original, pose);
  double worst = 0.0;
  for (std::size_t v = 0; v < there.size(); ++v) {
    for (Eigen::Index k = 0; k < 3; ++k) {
      const double moved = normalisation.scale * static_cast<double>(there[v][k]) + normalisation.offset[k];
      worst = std::max(worst, std::abs(moved - here[static_cast<std::int64_t>(v)][k].item<double>()));
    }
  }
  EXPECT_LT(worst, 1e-5);
  EXPECT_THROW(clip_of(poses, original.skeleton, normalisation, 0.0, ""), InputError);
}

TEST(Tracking, RefusesWhatCannotBeTracked) {
  const Asset bar = test::two_bone_bar();
  const RigTensors rig = rig_tensors(bar);
  EXPECT_THROW(track(rig, {}, quick()), InputError);
  TrackedFrame frame = bent_frame(bar, 10.0);
  frame.camera.focal_x = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(track(rig, {frame}, quick()), InputError);
  frame = bent_frame(bar, 10.0);
  frame.camera.world_to_camera(0, 3) = std::numeric_limits<double>::infinity();
  EXPECT_THROW(track(rig, {frame}, quick()), InputError);
  frame = bent_frame(bar, 10.0);
  frame.camera.world_to_camera(2, 3) = 0.0;  // inside the bar
  EXPECT_THROW(track(rig, {frame}, quick()), InputError);
  frame = bent_frame(bar, 10.0);
  frame.image = io::Image(160, 160, 0);
  EXPECT_THROW(track(rig, {frame}, quick()), InputError);
  TrackOptions options = quick();
  options.resolution = 8;
  EXPECT_THROW(track(rig, {bent_frame(bar, 10.0)}, options), InputError);
  Asset bare = bar;
  bare.skin = {};
  EXPECT_THROW(rig_tensors(bare), InputError);
  bare = bar;
  bare.mesh.faces.clear();
  EXPECT_THROW(rig_tensors(bare), InputError);
}

TEST(Tracking, FitsACameraToTheFirstFrame) {
  const Asset bar = test::two_bone_bar();
  const RigTensors rig = rig_tensors(bar);
  const FrameLevel level = frame_level(bent_frame(bar, 0.0).image, 64, "frame");
  const FittedCamera fitted = fit_camera(rig, level);
  EXPECT_GT(fitted.overlap, 0.9);
  EXPECT_NEAR(fitted.yaw_degrees, 15.0, 15.0);  // a square bar looks much alike from there
}

}  // namespace
}  // namespace anigen::tracking
