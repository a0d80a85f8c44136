#include "anigen/motions/limbs.h"

#include <gtest/gtest.h>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "tests/motions/made_bodies.h"

namespace anigen::motions {

namespace {

std::size_t count(const Body& body, LimbKind kind) { return body.of_kind(kind).size(); }

TEST(Limbs, OfABipedWithAndWithoutNames) {
  for (const bool names : {true, false}) {
    const Body body = analyse(test::made_biped(names));
    EXPECT_EQ(count(body, LimbKind::kLeg), 2U);
    EXPECT_EQ(count(body, LimbKind::kArm), 2U);
    EXPECT_EQ(count(body, LimbKind::kHead), 1U);
    EXPECT_EQ(count(body, LimbKind::kTail), 0U);
    EXPECT_TRUE(body.is_upright());
    EXPECT_TRUE(body.figure.forward.isApprox(-Eigen::Vector3d::UnitY()));
    const Limb& left = body.limbs[at(body.leg_pairs().front()[0])];
    EXPECT_EQ(left.side, 1);
    EXPECT_GT(left.tip.x(), 0.0);
    // Thigh, shin, foot, toe: the foot is the first joint whose surface touches the ground.
    ASSERT_EQ(left.joints.size(), 4U);
    EXPECT_EQ(left.hip, 0U);
    EXPECT_EQ(left.knee, 1U);
    EXPECT_EQ(left.ankle, 2U);
    ASSERT_EQ(body.trunk.size(), 3U);
    EXPECT_EQ(body.trunk.front(), 0);
  }
}

TEST(Limbs, OfAQuadrupedFromFrontToBack) {
  const Body body = analyse(test::made_quadruped(false));
  const auto pairs = body.leg_pairs();
  ASSERT_EQ(pairs.size(), 2U);
  EXPECT_LT(body.limbs[at(pairs[0][0])].contact.y(), body.limbs[at(pairs[1][0])].contact.y());
  EXPECT_EQ(count(body, LimbKind::kTail), 1U);
  EXPECT_EQ(count(body, LimbKind::kHead), 1U);
  EXPECT_FALSE(body.is_upright());
  EXPECT_EQ(body.limbs[at(body.of_kind(LimbKind::kTail).front())].joints.size(), 3U);
}

TEST(Limbs, OfInsects) {
  for (const int pairs : {3, 4, 5}) EXPECT_EQ(analyse(test::made_insect(pairs)).leg_pairs().size(), at(pairs));
}

TEST(Limbs, OfWhatHasNoLegs) {
  const Body snake = analyse(test::made_snake()), fish = analyse(test::made_fish()), lamp = analyse(test::made_lamp());
  for (const Body* body : {&snake, &fish, &lamp}) EXPECT_EQ(count(*body, LimbKind::kLeg), 0U);
  EXPECT_TRUE(snake.is_snake());
  EXPECT_EQ(snake.axis.size(), 12U);
  EXPECT_FALSE(fish.is_snake());
  EXPECT_EQ(fish.axis.size(), 6U);
  EXPECT_EQ(count(fish, LimbKind::kFin), 2U);
  EXPECT_TRUE(lamp.axis.empty());
  EXPECT_EQ(count(lamp, LimbKind::kArm), 0U);
}

TEST(Limbs, FaceWhereSidesAreNamed) {
  Asset turned = test::made_biped();  // a quarter turn: left is now +Y, the front +X
  for (Eigen::Vector3f& v : turned.mesh.vertices) v = Eigen::Vector3f(-v.y(), v.x(), v.z());
  std::vector<Eigen::Vector3d> places = turned.skeleton.positions();
  for (Eigen::Vector3d& p : places) p = Eigen::Vector3d(-p.y(), p.x(), p.z());
  turned.skeleton = skeleton_from_joints(places, turned.skeleton.parents, turned.skeleton.names);
  const Body body = analyse(turned);
  EXPECT_TRUE(body.figure.forward.isApprox(Eigen::Vector3d::UnitX()));
  EXPECT_EQ(body.leg_pairs().size(), 1U);
}

TEST(Limbs, FeetThatTheRootCarriesHangOnTheShin) {
  Asset asset = test::made_biped();
  // A root above all, and the left foot with its toe below it, as targets of inverse kinematics are exported.
  std::vector<Eigen::Vector3d> places = {Eigen::Vector3d::Zero()};
  std::vector<int> parents = {-1};
  std::vector<std::string> names = {"armature"};
  std::size_t foot = 0, shin = 0;
  for (std::size_t j = 0; j < asset.skeleton.size(); ++j) {
    places.push_back(asset.skeleton.positions()[j]);
    names.push_back(asset.skeleton.names[j]);
    if (names.back() == "foot.L") foot = j + 1;
    if (names.back() == "shin.L") shin = j + 1;
    parents.push_back(names.back() == "foot.L" ? 0 : asset.skeleton.parents[j] + 1);
  }
  asset.skeleton = skeleton_from_joints(places, parents, names);
  for (Influence& influence : asset.skin.influences) ++influence.joint;
  // The shin's box ends in the foot: rigs share vertices there.
  const Body body = analyse(asset);
  EXPECT_EQ(body.figure.tree.parents[foot], static_cast<int>(shin));
  EXPECT_EQ(body.leg_pairs().size(), 1U);
}

TEST(Limbs, PairsByNamesWhoseNumbersDiffer) {
  Asset asset = test::made_biped();
  const std::vector<int> mirror = figure_of(asset).mirror;
  for (std::size_t j = 0; j < asset.skeleton.size(); ++j) asset.skeleton.names[j] += "_0" + std::to_string(j);
  EXPECT_EQ(figure_of(asset).mirror, mirror);
}

TEST(Limbs, RefuseWhatHasNoRig) {
  Asset asset = test::made_biped();
  Asset no_skin = asset, no_skeleton = asset, no_mesh = asset, broken = asset;
  no_skin.skin = {};
  no_skeleton.skeleton = {};
  no_mesh.mesh = {};
  broken.mesh.vertices[3].x() = std::numeric_limits<float>::quiet_NaN();
  for (const Asset* bad : {&no_skin, &no_skeleton, &no_mesh, &broken}) EXPECT_THROW(figure_of(*bad), InputError);
}

}  // namespace

}  // namespace anigen::motions
