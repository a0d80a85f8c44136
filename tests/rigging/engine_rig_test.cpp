#include "anigen/rigging/engine_rig.h"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "tests/rigging/human_rig.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::rigging {

namespace {

using test::HumanRig;

Eigen::Matrix3d axes_of(const Skeleton& skeleton, int joint) { return skeleton.bind[at(joint)].topLeftCorner<3, 3>(); }

TEST(BoneAxes, AlongPointsYToTheChildWithMirroredRolls) {
  const HumanRig rig;
  const Skeleton given = rig.skeleton();
  const Skeleton skeleton = with_bone_axes(given, BoneAxes::kAlong);
  for (std::size_t j = 0; j < given.size(); ++j) {
    EXPECT_LT((skeleton.positions()[j] - given.positions()[j]).norm(), 1e-12) << "joint " << j << " stays";
    const Eigen::Matrix3d axes = axes_of(skeleton, static_cast<int>(j));
    EXPECT_LT((axes * axes.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-12);
    EXPECT_NEAR(axes.determinant(), 1.0, 1e-12);
  }
  const auto y = [&](const std::string& word) { return Eigen::Vector3d(axes_of(skeleton, rig.index(word)).col(1)); };
  EXPECT_GT(y("hips").z(), 0.99) << "up the spine, not down a leg or along the tail";
  EXPECT_GT(y("chest").z(), 0.9) << "between neck and shoulders";
  EXPECT_GT(y("l_upper_arm").x(), 0.99) << "the twist joint leads the same way";
  EXPECT_LT(y("r_lower_leg").z(), -0.99);
  EXPECT_EQ(y("l_hand_end"), y("l_hand")) << "ends go on";
  const Eigen::Vector3d mirror(-1, 1, 1);
  for (const char* word : {"shoulder", "upper_arm", "lower_arm", "hand", "upper_leg", "lower_leg", "foot", "toes"}) {
    const Eigen::Matrix3d left = axes_of(skeleton, rig.index(std::string("l_") + word));
    const Eigen::Matrix3d right = axes_of(skeleton, rig.index(std::string("r_") + word));
    EXPECT_LT((right.col(1) - mirror.cwiseProduct(left.col(1))).norm(), 1e-9) << word;
    EXPECT_LT((right.col(2) - mirror.cwiseProduct(left.col(2))).norm(), 1e-9) << word;
    EXPECT_LT((right.col(0) + mirror.cwiseProduct(left.col(0))).norm(), 1e-9) << word;
  }
  EXPECT_THROW(parse_bone_axes("up"), InputError);
}

EngineRig made(const HumanRig& rig, const EngineOptions& options, bool named = false) {
  const Asset asset = rig.asset(named);
  return engine_rig(asset.skeleton, bounding_box(asset.mesh.vertices), rig.weight(), options, "person.glb");
}

// The mesh in its bind pose is what the skinned mesh shows, whatever was asked for.
TEST(EngineRig, SkinsTheMeshAsItIsPlaced) {
  HumanRig rig;
  rig["root"].carries = true;  // no root bone that would do
  EngineOptions options;
  options.axes = BoneAxes::kAlong;
  options.height = 1.2;
  options.ground = options.root_bone = true;
  options.names = NameStyle::kUnreal;
  Asset asset = rig.asset();
  const Box before = bounding_box(asset.mesh.vertices);
  apply(engine_rig(asset.skeleton, before, rig.weight(), options, "person.glb"), asset);
  EXPECT_TRUE(validate(asset).empty());
  const Box box = bounding_box(asset.mesh.vertices);
  EXPECT_NEAR(box.low.z(), 0.0, 1e-6);
  EXPECT_NEAR(box.high.z(), 1.2, 1e-6);
  const double scale = 1.2 / (before.high.z() - before.low.z());
  const std::vector<Eigen::Vector3f> rested =
      skin_vertices(asset, forward_kinematics(asset.skeleton.parents, asset.skeleton.rest));
  for (std::size_t v = 0; v < rested.size(); ++v)
    ASSERT_LE((rested[v] - asset.mesh.vertices[v]).norm(), 1e-6F) << "vertex " << v;
  const Eigen::Vector3d hips = asset.skeleton.positions()[2];
  EXPECT_EQ(asset.skeleton.names[2], "pelvis");
  EXPECT_LT(hips.head<2>().norm(), 1e-9);
  EXPECT_NEAR(hips.z(), scale * (rig.skeleton().positions()[1].z() - before.low.z()), 1e-9);
  EXPECT_EQ(asset.skeleton.names[0], "root");
  EXPECT_LT(asset.skeleton.positions()[0].norm(), 1e-12);
  EXPECT_EQ(asset.skeleton.parents[1], 0);
  const std::vector<double> weight = weight_of_joints(asset.skin, asset.skeleton.size());
  EXPECT_EQ(weight[0], 0.0);
  EXPECT_GT(weight[2], 0.0);
}

TEST(EngineRig, NamesKeepWhatIsNoBone) {
  const HumanRig rig;
  EngineOptions options;
  options.names = NameStyle::kVrm;
  const EngineRig vrm = made(rig, options);
  EXPECT_TRUE(vrm.has_given_joints);
  EXPECT_EQ(vrm.skeleton.names[at(rig.index("r_lower_arm"))], "rightLowerArm");
  EXPECT_EQ(vrm.skeleton.names[at(rig.index("tail_2"))], "j" + std::to_string(rig.index("tail_2")));
  options.names = NameStyle::kChain;
  const std::vector<std::string> chains = made(rig, options).skeleton.names;
  EXPECT_NE(std::find(chains.begin(), chains.end(), "chain_0_00"), chains.end());
}

TEST(EngineRig, ARootBoneThatIsThereIsEnough) {
  HumanRig rig;
  EngineOptions options;
  options.root_bone = true;
  const std::size_t joints = rig.joints.size();
  EXPECT_EQ(made(rig, options).skeleton.size(), joints + 1) << "the root is at (3, 2)";
  EXPECT_FALSE(made(rig, options).has_given_joints);
  options.ground = true;
  options.names = NameStyle::kUnity;  // hips known: the idle root comes below them, to the origin
  const EngineRig grounded = made(rig, options);
  EXPECT_EQ(grounded.skeleton.size(), joints);
  EXPECT_NE(grounded.note.find("root bone already"), std::string::npos);
}

TEST(EngineRig, HumanoidsOfVrmFaceForwardInOneTree) {
  HumanRig rig;
  rig["l_foot"].parent = rig["r_foot"].parent = "root";
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.5 * EIGEN_PI, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Skeleton skeleton = rig.skeleton(false, turn);
  Box box;
  for (const Eigen::Vector3d& place : skeleton.positions()) box.extend(place);
  EngineOptions options;
  options.humanoid = true;
  const EngineRig found = engine_rig(skeleton, box, rig.weight(), options, "person.glb");
  EXPECT_LT((found.humanoid.forward + Eigen::Vector3d::UnitY()).norm(), 0.05);
  const auto place = [&](HumanBone bone) { return found.skeleton.positions()[at(found.humanoid[bone])]; };
  EXPECT_GT(place(HumanBone::kLeftHand).x(), place(HumanBone::kRightHand).x() + 1.0);
  for (std::size_t j = 1; j < found.skeleton.size(); ++j) EXPECT_LT(found.skeleton.parents[j], static_cast<int>(j));
  EXPECT_EQ(found.skeleton.parents[at(found.humanoid[HumanBone::kLeftFoot])], found.humanoid[HumanBone::kLeftLowerLeg]);
  EXPECT_FALSE(found.has_given_joints);
}

TEST(EngineRig, RefusesWhatIsNoHumanoidAndWhatHasNoHeight) {
  const Skeleton stick = skeleton_from_joints({{0, 0, 0}, {0, 0, 1}}, {-1, 0});
  Box box;
  box.extend(Eigen::Vector3d(0, 0, 0));
  EngineOptions options;
  options.names = NameStyle::kMixamo;
  const std::string message = test::refusal([&] { engine_rig(stick, box, {}, options, "stick.glb"); });
  EXPECT_NE(message.find("leftUpperArm"), std::string::npos) << message;
  EXPECT_NE(message.find("--names"), std::string::npos) << message;
  options = {};
  options.height = 2.0;
  EXPECT_THROW(engine_rig(stick, box, {}, options, "stick.glb"), InputError);
}

}  // namespace

}  // namespace anigen::rigging
