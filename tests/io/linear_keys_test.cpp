#include "anigen/io/linear_keys.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "anigen/asset/skeleton.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"

namespace anigen::io {
namespace {

Eigen::Quaterniond rotation_of(const Eigen::Vector3d& degrees) {
  const Eigen::Vector3d a = kPi / 180.0 * degrees;
  return Eigen::AngleAxisd(a.z(), Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(a.y(), Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(a.x(), Eigen::Vector3d::UnitX());
}

Channel rotation_channel(const std::vector<double>& times, const std::vector<Eigen::Quaterniond>& rotations) {
  Channel channel{0, ChannelPath::kRotation, Interpolation::kLinear, times, {}};
  for (const Eigen::Quaterniond& q : rotations)
    channel.values.insert(channel.values.end(), {q.x(), q.y(), q.z(), q.w()});
  return channel;
}

Transform sampled_at(const Channel& channel, double time) {
  return sample({"", {channel}}, skeleton_from_joints({Eigen::Vector3d::Zero()}, {-1}), time).front();
}

TEST(LinearKeys, LinearKeysStayWhereTheyAre) {
  const Channel channel{0, ChannelPath::kTranslation, Interpolation::kLinear, {0.1, 0.5}, {1, 2, 3, 4, 5, 6}};
  const LinearKeys keys = linear_keys(channel);
  EXPECT_EQ(keys.times, channel.times);
  EXPECT_EQ(keys.values[1].head<3>(), Eigen::Vector3d(4, 5, 6));
  EXPECT_LT((keys.value_at(0.3).head<3>() - Eigen::Vector3d(2.5, 3.5, 4.5)).norm(), 1e-12);
  EXPECT_EQ(keys.value_at(0.0).head<3>(), Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(keys.value_at(9.0).head<3>(), Eigen::Vector3d(4, 5, 6));
}

TEST(LinearKeys, AStepIsAShortRampBeforeItsKey) {
  const Channel channel{0, ChannelPath::kScale, Interpolation::kStep, {0.25, 0.75}, {1, 1, 1, 2, 1, 0.5}};
  const LinearKeys keys = linear_keys(channel);
  ASSERT_EQ(keys.times.size(), 3u);
  EXPECT_EQ(keys.value_at(0.75 - 1.001 * kStepRamp).head<3>(), Eigen::Vector3d(1, 1, 1));
  EXPECT_EQ(keys.value_at(0.75).head<3>(), Eigen::Vector3d(2, 1, 0.5));
}

TEST(LinearKeys, ASplineGetsTheKeysThatItNeeds) {
  const Channel move{0,
                     ChannelPath::kTranslation,
                     Interpolation::kCubicSpline,
                     {0.0, 1.0},
                     {0, 0, 0, 0, 0, 0, 3, 0, 0, -5, 0, 0, 1, 2, 0, 0, 0, 0}};
  Channel turn{0, ChannelPath::kRotation, Interpolation::kCubicSpline, {0.0, 2.0}, {}};
  turn.values = {0, 0, 0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0.5, 0, 0, 0, std::sqrt(0.5), 0, std::sqrt(0.5), 0, 0, 0, 0};
  const LinearKeys moving = linear_keys(move), turning = linear_keys(turn);
  EXPECT_GT(moving.times.size(), 4u);
  EXPECT_LT(moving.times.size(), 500u);
  for (int i = 0; i <= 1000; ++i) {
    const double t = i / 1000.0;
    // Twice the tolerance, since it is held at three places of an interval. What is moved ranges over 2.
    EXPECT_LT((moving.value_at(t).head<3>() - sampled_at(move, t).translation).norm(), 2e-4) << t;
    const Eigen::Vector4d q = turning.value_at(2.0 * t);
    EXPECT_LT(Eigen::Quaterniond(q[3], q[0], q[1], q[2]).angularDistance(sampled_at(turn, 2.0 * t).rotation), 4e-5);
  }
}

TEST(EulerKeys, AnglesGiveTheRotationAndStayNear) {
  Rng rng(1, "euler", 0);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d wanted(rng.uniform(-700, 700), rng.uniform(-89, 89), rng.uniform(-700, 700));
    const Eigen::Vector3d found =
        euler_degrees(rotation_of(wanted).toRotationMatrix(), wanted + Eigen::Vector3d(5, 1, -5));
    EXPECT_LT((found - wanted).norm(), 1e-6);
  }
  for (const double y : {90.0, -90.0}) {  // where x and z turn about one axis
    const Eigen::Vector3d degrees(20, y, 50);
    const Eigen::Vector3d found = euler_degrees(rotation_of(degrees).toRotationMatrix(), {0, y, 300});
    EXPECT_LT(rotation_of(found).angularDistance(rotation_of(degrees)), 1e-6);
    EXPECT_NEAR(found.z(), 300.0, 180.0);
  }
}

TEST(EulerKeys, TurnsAreCountedOn) {
  std::vector<double> times;
  std::vector<Eigen::Quaterniond> rotations;
  for (int i = 0; i <= 24; ++i) {
    times.push_back(i / 24.0);
    rotations.push_back(rotation_of({30.0 * i, 0.0, 0.0}));
  }
  const EulerKeys keys = euler_keys(linear_keys(rotation_channel(times, rotations)));
  EXPECT_NEAR(keys.degrees.back().x(), 720.0, 1e-6);
  EXPECT_EQ(keys.times.size(), times.size());  // one axis: straight lines of angles are the arcs
}

TEST(EulerKeys, StraightLinesOfAnglesFollowTheArc) {
  Rng rng(2, "euler", 0);
  for (int i = 0; i < 40; ++i) {
    const auto random = [&rng] {
      return rotation_of({rng.uniform(-180, 180), rng.uniform(-90, 90), rng.uniform(-180, 180)});
    };
    const LinearKeys keys = linear_keys(rotation_channel({0.0, 0.5, 1.0}, {random(), random(), random()}));
    const EulerKeys angles = euler_keys(keys);
    double worst = 0.0;
    for (std::size_t k = 1; k < angles.times.size(); ++k) {
      for (const double part : {0.2, 0.5, 0.7}) {
        const double time = angles.times[k - 1] + part * (angles.times[k] - angles.times[k - 1]);
        const Eigen::Vector4d q = keys.value_at(time);
        const Eigen::Vector3d between = (1.0 - part) * angles.degrees[k - 1] + part * angles.degrees[k];
        worst = std::max(worst, rotation_of(between).angularDistance(Eigen::Quaterniond(q[3], q[0], q[1], q[2])));
      }
    }
    EXPECT_LT(worst, 5e-3);  // near the pole of the angles the closest keys allowed decide
    EXPECT_LT(angles.times.size(), 600u);
  }
}

TEST(FrameRate, IsThatOnWhoseFramesKeysLie) {
  const auto rate = [](const std::vector<double>& times) {
    Channel channel;
    channel.times = times;
    return frame_rate({{"", {channel}}});
  };
  EXPECT_EQ(rate({0.0, 1.0}), 30.0);
  EXPECT_EQ(rate({0.0, 1.0 / 24, 2.0 / 24}), 24.0);
  EXPECT_EQ(rate({0.0, 0.04}), 25.0);
  EXPECT_EQ(rate({0.0, 1.0 / 60}), 60.0);
  EXPECT_EQ(rate({0.0123, 0.0777}), 30.0);
}

}  // namespace
}  // namespace anigen::io
