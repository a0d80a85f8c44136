#include "anigen/motions/built_in.h"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/motions/contact.h"
#include "anigen/motions/gaits.h"
#include "tests/motions/made_bodies.h"

namespace anigen::motions {

namespace {

std::vector<Asset> bodies() {
  return {test::made_biped(),   test::made_quadruped(), test::made_insect(3), test::made_insect(4),
          test::made_insect(5), test::made_snake(),     test::made_fish(),    test::made_lamp()};
}

double largest_difference(const JointMotions& a, const JointMotions& b) {
  double largest = 0.0;
  for (std::size_t j = 0; j < a.size(); ++j) {
    largest = std::max(largest, (a[j].turn - b[j].turn).norm());
    largest = std::max(largest, (a[j].shift - b[j].shift).norm());
  }
  return largest;
}

TEST(BuiltInMotions, AreSoundClipsThatClose) {
  for (const Asset& asset : bodies()) {
    const Body body = analyse(asset);
    const std::vector<std::string> words = motions_of(body);
    EXPECT_GE(words.size(), 2U);
    for (const std::string& word : words) {
      SCOPED_TRACE(word + " of " + describe(body));
      const BodyMotion motion = make_motion(body, word);
      EXPECT_EQ(motion.loops, word != "jump");
      if (motion.loops) {
        EXPECT_EQ(largest_difference(motion.poses.front(), motion.poses.back()), 0.0);
      }
      double moved = 0.0;
      for (const JointMotions& pose : motion.poses)
        moved = std::max(moved, largest_difference(pose, motion.poses.front()));
      EXPECT_GT(moved, 1e-3);
      Asset animated = asset;
      animated.animations = {to_clip(motion, asset.skeleton)};
      EXPECT_TRUE(validate(animated).empty());
      for (const Channel& channel : animated.animations.front().channels) {
        if (channel.path != ChannelPath::kRotation) continue;
        for (std::size_t k = 0; k < channel.times.size(); ++k)
          EXPECT_NEAR(Eigen::Map<const Eigen::Vector4d>(channel.values.data() + 4 * k).norm(), 1.0, 1e-9);
      }
    }
  }
}

TEST(BuiltInMotions, WalkingFeetDoNotSlide) {
  for (const Asset& asset : bodies()) {
    const Body body = analyse(asset);
    if (body.leg_pairs().empty()) continue;
    for (const char* word : {"walk", "run"}) {
      for (const bool travel : {false, true}) {
        SCOPED_TRACE(std::string(word) + " of " + describe(body));
        MotionOptions options;
        options.travel = travel;
        const BodyMotion motion = make_motion(body, word, options);
        const Animation clip = to_clip(motion, asset.skeleton);
        EXPECT_EQ(motion.contacts.size(), 2 * body.leg_pairs().size());
        EXPECT_EQ(motion.ground_velocity.norm() > 0.0, !travel);
        EXPECT_LT(foot_slide(body, motion, clip, asset.skeleton), 0.01);
        // Each foot stands, and each leaves the ground.
        for (const FootContact& contact : motion.contacts) {
          EXPECT_NE(std::count(contact.stands.begin(), contact.stands.end(), true), 0);
          EXPECT_NE(std::count(contact.stands.begin(), contact.stands.end(), false), 0);
        }
        const Eigen::Vector3d way = motion.poses.back()[0].shift - motion.poses.front()[0].shift;
        EXPECT_EQ(way.dot(body.figure.forward) > 0.2 * body.leg_length(), travel);
      }
    }
  }
}

TEST(BuiltInMotions, SlideIsSeenWhereThereIsSome) {
  const Asset asset = test::made_quadruped();
  const Body body = analyse(asset);
  BodyMotion motion = make_motion(body, "walk");
  const Animation clip = to_clip(motion, asset.skeleton);
  motion.ground_velocity *= 0.5;
  EXPECT_GT(foot_slide(body, motion, clip, asset.skeleton), 0.05);
}

TEST(BuiltInMotions, GaitsAlternate) {
  const auto together = [](const Gait& gait, std::size_t a, std::size_t b) { return gait.phase[a] == gait.phase[b]; };
  const Gait two = gait_of(analyse(test::made_biped()), false);
  EXPECT_NEAR(std::abs(two.phase[0] - two.phase[1]), 0.5, 1e-12);
  const Gait trot = gait_of(analyse(test::made_quadruped()), true);
  EXPECT_TRUE(together(trot, 0, 3));  // diagonal legs
  EXPECT_TRUE(together(trot, 1, 2));
  const Gait six = gait_of(analyse(test::made_insect(3)), false);
  EXPECT_TRUE(together(six, 0, 3) && together(six, 0, 4));  // tripod: left front, right middle, left hind
  for (const int pairs : {4, 5}) {
    const Gait many = gait_of(analyse(test::made_insect(pairs)), false);
    for (int step = 0; step < 20; ++step) {
      std::size_t standing = 0;
      for (std::size_t leg = 0; leg < many.phase.size(); ++leg) standing += stands(many, leg, step / 20.0) ? 1 : 0;
      EXPECT_GE(standing, 3U);  // three carry a body
    }
  }
}

TEST(BuiltInMotions, ArmsHangInIdleAndAreLevelInTPose) {
  const Asset asset = test::made_biped();
  const Body body = analyse(asset);
  const JointMotions idle = make_motion(body, "idle").poses.front(), straight = t_pose(body).poses.front();
  for (const int i : body.of_kind(LimbKind::kArm)) {
    const Limb& arm = body.limbs[at(i)];
    const Eigen::Vector3d shoulder = body.figure.tree.positions[at(arm.joints.front())];
    const auto place = [&](const JointMotions& pose) {
      return Eigen::Vector3d(pose[at(arm.joints.back())](body.figure.tree.positions[at(arm.joints.back())]) -
                             pose[at(arm.joints.front())](shoulder));
    };
    EXPECT_LT(place(idle).normalized().z(), -0.8);
    EXPECT_NEAR(place(straight).normalized().z(), 0.0, 1e-6);
  }
  EXPECT_THROW(t_pose(analyse(test::made_snake())), InputError);
}

TEST(BuiltInMotions, WhatABodyCannotDoIsRefusedWithWhatItCan) {
  const Body snake = analyse(test::made_snake());
  try {
    make_motion(snake, "walk");
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("legs in pairs"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("slither"), std::string::npos);
  }
  EXPECT_THROW(make_motion(snake, "gallop"), InputError);
  EXPECT_THROW(make_motion(analyse(test::made_biped()), "fly"), InputError);
  EXPECT_THROW(make_motion(analyse(test::made_lamp()), "jump"), InputError);
}

TEST(BuiltInMotions, OptionsSayFramesAndSpeed) {
  const Body body = analyse(test::made_biped());
  MotionOptions options;
  options.frames = 9;
  options.speed = 2.0;
  const BodyMotion fast = make_motion(body, "walk", options);
  EXPECT_EQ(fast.times.size(), 9U);
  EXPECT_NEAR(2.0 * fast.times.back(), make_motion(body, "walk").times.back(), 1e-9);
  options.speed = 0.0;
  EXPECT_THROW(make_motion(body, "walk", options), InputError);
  options.speed = std::nan("");
  EXPECT_THROW(make_motion(body, "walk", options), InputError);
  options = {};
  options.frames = 1;
  EXPECT_THROW(make_motion(body, "walk", options), InputError);
}

TEST(BuiltInMotions, IdleClipOfAnAsset) {
  const Asset asset = test::made_fish();
  const Animation clip = idle_clip(asset);
  EXPECT_EQ(clip.name, "idle");
  EXPECT_GT(clip.duration(), 1.0);
  Asset bare = asset;
  bare.skin = {};
  EXPECT_THROW(idle_clip(bare), InputError);
}

}  // namespace

}  // namespace anigen::motions
