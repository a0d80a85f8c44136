#include "anigen/tracking/objective.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/tracking/bent_chain.h"

namespace anigen::tracking {
namespace {

PinholeCamera camera_in_front() {
  PinholeCamera camera;
  // Looks along +y from y = −2.5; x right, y down is −z of the world.
  camera.world_to_camera << 1, 0, 0, 0.03, 0, 0, -1, 0.02, 0, 1, 0, 2.5, 0, 0, 0, 1;
  camera.focal_x = camera.focal_y = 1.4;
  camera.center_y = 0.53;
  return camera;
}

Tensor turns_of(std::initializer_list<double> numbers) {
  return torch::tensor(std::vector<double>(numbers), torch::kFloat64).view({1, 2, 3});
}

// A frame of the bar in a pose, made by the rasteriser itself.
FrameLevel frame_of(const RigTensors& rig, const Tensor& turns, std::int64_t size) {
  const PosedRig pose = posed(rig, turns, torch::zeros({1, 3}, torch::kFloat64));
  const Rendering seen =
      render_rig(rig, clip_positions(pose.vertices[0], camera_in_front()), pose.normals[0], plain_light(), 4 * size);
  const Tensor rgba = torch::cat({seen.color.clamp(0, 1).pow(2.0 / 2.2), seen.mask.unsqueeze(2).clamp(0, 1)}, 2);
  io::Image image(static_cast<int>(4 * size), static_cast<int>(4 * size));
  const Tensor bytes = (255.0 * rgba).round().to(torch::kUInt8).contiguous();
  std::copy_n(bytes.data_ptr<std::uint8_t>(), image.rgba.size(), image.rgba.begin());
  return frame_level(image, size, "frame");
}

class TrackingObjective : public ::testing::Test {
 protected:
  Asset bar = test::two_bone_bar();
  RigTensors rig = rig_tensors(bar);

  double energy(const Tensor& x, const Tensor& s, const FrameLevel& frame, const ObjectiveWeights& weights,
                Tensor* turn_slope = nullptr, Tensor* shift_slope = nullptr) const {
    const Tensor turns = x.clone().requires_grad_(), shift = s.clone().requires_grad_();
    const PosedRig pose = posed(rig, turns, shift);
    const Tensor before = torch::full_like(x, 0.05), shift_before = torch::full_like(s, 0.01);
    const Tensor sum =
        picture_energy(rig, pose.vertices[0], pose.normals[0], camera_in_front(), frame, plain_light(), weights) +
        pose_energy(rig, turns, weights) + change_energy(rig, turns, before, shift, shift_before, 1.0, weights.step);
    if (turn_slope != nullptr) {
      sum.backward();
      *turn_slope = turns.grad();
      *shift_slope = shift.grad();
    }
    return sum.item<double>();
  }
};

// Along several directions. Colours of a rasterised picture jump where a pixel changes its triangle, and the light of
// the posed normals is kept; what has an exact derivative is the geometry, so colours have their own test below.
TEST_F(TrackingObjective, GradientEqualsFiniteDifferences) {
  const FrameLevel frame = frame_of(rig, turns_of({0, 0.05, 0, 0, 0.4, 0}), 48);
  ObjectiveWeights weights;
  weights.color = 0.0;
  const Tensor x = turns_of({0.02, 0.01, -0.03, 0.05, 0.9, 0.04}),
               s = torch::tensor({{0.02, 0.01, -0.015}}, torch::kFloat64);
  Tensor turn_slope, shift_slope;
  energy(x, s, frame, weights, &turn_slope, &shift_slope);
  torch::manual_seed(1);
  for (int k = 0; k < 8; ++k) {
    const Tensor dx = torch::randn({1, 2, 3}, torch::kFloat64), ds = 0.3 * torch::randn({1, 3}, torch::kFloat64);
    const double step = 1e-6;
    const double slope =
        (energy(x + step * dx, s + step * ds, frame, weights) - energy(x - step * dx, s - step * ds, frame, weights)) /
        (2.0 * step);
    const double found = ((turn_slope * dx).sum() + (shift_slope * ds).sum()).item<double>();
    EXPECT_NEAR(found, slope, 2e-3 * std::max(1.0, std::abs(slope))) << k;
  }
}

TEST_F(TrackingObjective, KinematicsDifferentiateTurnsAndShift) {
  Asset doll = bar;
  doll.skeleton = skeleton_from_joints({{0.1, 0, -0.5}, {0, 0.1, 0}}, {-1, 0}, {"lower", "upper"});
  doll.skeleton.bind[1].topLeftCorner<3, 3>() =
      Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix() *
      Eigen::Vector3d(1.2, 0.9, 1.1).asDiagonal();
  const RigTensors turned = rig_tensors(doll);
  torch::manual_seed(2);
  const Tensor turns = torch::randn({3, 2, 3}, torch::kFloat64), shift = torch::randn({3, 3}, torch::kFloat64),
               weight = torch::randn({3, 2, 3, 4}, torch::kFloat64);
  const auto value = [&](const Tensor& x, const Tensor& s) { return (joint_matrices(turned, x, s) * weight).sum(); };
  const Tensor x = turns.clone().requires_grad_(), s = shift.clone().requires_grad_();
  value(x, s).backward();
  for (int k = 0; k < 6; ++k) {
    const Tensor dx = torch::randn_like(turns), ds = torch::randn_like(shift);
    const double step = 1e-6;
    const double slope =
        ((value(turns + step * dx, shift + step * ds) - value(turns - step * dx, shift - step * ds)) / (2.0 * step))
            .item<double>();
    EXPECT_NEAR(((x.grad() * dx).sum() + (s.grad() * ds).sum()).item<double>(), slope, 1e-7 * (1.0 + std::abs(slope)));
  }
}

// Between turns so far apart that the jumps of single pixels average out.
TEST_F(TrackingObjective, ColorsTellATurnAboutTheBone) {
  const FrameLevel frame = frame_of(rig, turns_of({0, 0, 0, 0, 0, 0.4}), 96);
  ObjectiveWeights weights;
  weights.silhouette = weights.distance = weights.rest = weights.twist = weights.step = 0.0;
  const Tensor s = torch::zeros({1, 3}, torch::kFloat64);
  const auto at = [&](double turn) { return energy(turns_of({0, 0, 0, 0, 0, turn}), s, frame, weights); };
  const double right = at(0.4);
  for (const double wrong : {-0.3, 0.0, 0.8}) EXPECT_LT(2.0 * right, at(wrong)) << wrong;
}

TEST_F(TrackingObjective, DistanceTermPullsBackWhatHasLostItsOverlap) {
  const FrameLevel frame = frame_of(rig, turns_of({0, 0, 0, 0, 0, 0}), 48);
  ObjectiveWeights weights;
  Tensor turn_slope, shift_slope;
  const Tensor away = torch::tensor({{0.6, 0.0, 0.0}}, torch::kFloat64);  // beside the frame's bar
  energy(turns_of({0, 0, 0, 0, 0, 0}), away, frame, weights, &turn_slope, &shift_slope);
  EXPECT_GT(shift_slope[0][0].item<double>(), 1.0);
}

TEST_F(TrackingObjective, LightIsRecovered) {
  const PosedRig pose = posed(rig, turns_of({0, 0, 0.6, 0, 0, 0}), torch::zeros({1, 3}, torch::kFloat64));
  const Tensor clip = clip_positions(pose.vertices[0], camera_in_front());
  Light light = plain_light();
  light[1].fill_(0.6);   // brighter on the side of +x
  light[2].fill_(-0.5);  // and of −y, where the camera is
  const Rendering seen = render_rig(rig, clip, pose.normals[0], light, 96);
  FrameLevel frame;
  frame.alpha = seen.mask;
  frame.color = seen.color;
  frame.area = seen.mask.sum().item<double>();
  const Rendering again = render_rig(rig, clip, pose.normals[0], fit_light(rig, clip, pose.normals[0], frame), 96);
  EXPECT_LT((again.color - seen.color).abs().mean().item<double>(), 5e-3);
  EXPECT_GT((render_rig(rig, clip, pose.normals[0], plain_light(), 96).color - seen.color).abs().mean().item<double>(),
            1e-2);
}

}  // namespace
}  // namespace anigen::tracking
