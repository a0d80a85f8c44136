#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/rig/embedding/embed_skeleton.h"
#include "anigen/rig/embedding/reduced_skeleton.h"
#include "tests/rig/embedding_bodies.h"

namespace anigen::rig {
namespace {

const TemplateJoint& template_joint(const TemplateSkeleton& skeleton, const std::string& name) {
  for (const TemplateJoint& joint : skeleton.joints) {
    if (joint.name == name) return joint;
  }
  throw InputError("", name, "is not there");
}

TEST(EmbeddingTemplate, PublishedOnesAreSoundAndMirrored) {
  for (const TemplateSkeleton& skeleton : {biped_template(), quadruped_template()}) {
    EXPECT_NO_THROW(check(skeleton));
    for (std::size_t j = 0; j < skeleton.joints.size(); ++j) {
      const TemplateJoint& joint = skeleton.joints[j];
      EXPECT_EQ(joint.mirror < 0, joint.position.x() == 0.0) << joint.name;
      if (joint.mirror < 0) continue;
      const TemplateJoint& other = skeleton.joints[static_cast<std::size_t>(joint.mirror)];
      EXPECT_EQ(other.mirror, static_cast<int>(j));
      EXPECT_EQ(other.position.x(), -joint.position.x());
      EXPECT_EQ(joint.name.rfind("left_", 0) == 0, joint.position.x() > 0.0);
    }
  }
}

TEST(EmbeddingTemplate, ReducesToBranchesAndTips) {
  const ReducedSkeleton reduced = reduced_skeleton(biped_template(), 0.5);
  ASSERT_EQ(reduced.joints.size(), 7u);
  int tips = 0, feet = 0;
  for (const ReducedJoint& joint : reduced.joints) {
    tips += joint.leaf ? 1 : 0;
    feet += joint.foot ? 1 : 0;
    if (joint.parent < 0) continue;
    EXPECT_DOUBLE_EQ(joint.fractions.back(), 1.0);
    EXPECT_TRUE(std::is_sorted(joint.fractions.begin(), joint.fractions.end()));
    EXPECT_EQ(joint.chain.back(), joint.joint);
  }
  EXPECT_EQ(tips, 5);
  EXPECT_EQ(feet, 2);
  EXPECT_EQ(reduced_skeleton(quadruped_template(), 0.5).joints.size(), 8u);
}

/// The biped with a root on the ground, three fingers on each hand and an eye.
Skeleton detailed_rig() {
  std::vector<Eigen::Vector3d> joints{{0, 0, -0.5}};
  std::vector<int> parents{-1};
  std::vector<std::string> names{"ground"};
  for (const TemplateJoint& joint : biped_template().joints) {
    joints.push_back(joint.position);
    parents.push_back(joint.parent + 1);
    names.push_back(joint.name);
  }
  const auto add = [&](const std::string& name, const std::string& parent, const Eigen::Vector3d& offset) {
    const auto at = static_cast<std::size_t>(std::find(names.begin(), names.end(), parent) - names.begin());
    joints.emplace_back(joints[at] + offset);
    parents.push_back(static_cast<int>(at));
    names.push_back(name);
  };
  for (const std::string side : {"left", "right"}) {
    const double x = side == "left" ? 1.0 : -1.0;
    add("thumb." + side, side + "_hand", {0.02 * x, -0.02, 0});
    add("thumb_end." + side, "thumb." + side, {0.02 * x, -0.02, 0});
    add("finger." + side, side + "_hand", {0.03 * x, 0.02, 0});
  }
  add("eye", "head", {0, -0.05, 0.02});
  return skeleton_from_joints(joints, parents, names);
}

TEST(EmbeddingTemplate, FromARigWithFingers) {
  Box box;
  box.low.setConstant(-0.5);
  box.high.setConstant(0.5);
  const TemplateSkeleton made = template_from_skeleton(detailed_rig(), box);
  for (const char* name : {"ground", "thumb.left", "thumb_end.right", "finger.left", "eye"}) {
    EXPECT_TRUE(template_joint(made, name).carried) << name;
  }
  for (const char* name : {"hips", "chest", "left_hand", "left_hand_tip", "right_toes_tip"}) {
    EXPECT_FALSE(template_joint(made, name).carried) << name;
  }
  EXPECT_TRUE(template_joint(made, "left_toes_tip").foot);
  EXPECT_FALSE(template_joint(made, "left_hand_tip").foot);
  EXPECT_TRUE(template_joint(made, "hips").fat && template_joint(made, "chest").fat);
  const TemplateJoint& thumb = template_joint(made, "thumb.left");
  ASSERT_GE(thumb.mirror, 0);
  EXPECT_EQ(made.joints[static_cast<std::size_t>(thumb.mirror)].name, "thumb.right");

  const Mesh mesh = test::capsule_mesh(test::person());
  const Skeleton rig = detailed_rig();
  const Skeleton embedded = embed_skeleton(mesh, made).skeleton;
  EXPECT_EQ(embedded.names, rig.names);
  EXPECT_EQ(embedded.parents, rig.parents);
  const auto joints = embedded.positions();
  std::map<std::string, Eigen::Vector3d> found;
  for (std::size_t j = 0; j < joints.size(); ++j) found[embedded.names[j]] = joints[j];
  for (const auto& [name, place] : test::person_joints()) {
    EXPECT_LT((found[name] - place).norm(), 0.09) << name << " at " << found[name].transpose();
  }
  // What is carried keeps its distance, but for the scale of the bone it follows.
  const double reach = (found["thumb_end.left"] - found["left_hand"]).norm();
  EXPECT_GT(reach, 0.02);
  EXPECT_LT(reach, 0.12);
  EXPECT_NEAR(found["ground"].z(), -0.5, 0.05);
}

TEST(EmbeddingTemplate, NamesTellSides) {
  // A pose that mirrors nothing.
  const Skeleton posed =
      skeleton_from_joints({{0, 0, 0}, {0.3, 0, 0.3}, {-0.1, 0, -0.4}, {0.2, 0.3, 0}, {-0.4, 0, 0.1}, {0, 0, 0.5}},
                           {-1, 0, 0, 0, 0, 0}, {"root", "arm.L", "arm.R", "LeftLeg", "RightLeg", "tail"});
  const TemplateSkeleton made = template_from_skeleton(posed);
  EXPECT_EQ(made.joints[1].mirror, 2);
  EXPECT_EQ(made.joints[3].mirror, 4);
  EXPECT_EQ(made.joints[5].mirror, -1);
}

TEST(EmbeddingTemplate, RefusesBrokenTrees) {
  TemplateSkeleton skeleton = biped_template();
  skeleton.joints[3].parent = 9;
  EXPECT_THROW(check(skeleton), InputError);
  skeleton = biped_template();
  skeleton.joints[3].parent = -1;
  EXPECT_THROW(check(skeleton), InputError);
  skeleton = biped_template();
  skeleton.joints[3].position.x() = std::nan("");
  EXPECT_THROW(check(skeleton), InputError);
  skeleton = biped_template();
  skeleton.joints[3].mirror = 99;
  EXPECT_THROW(check(skeleton), InputError);
  skeleton.joints.clear();
  EXPECT_THROW(check(skeleton), InputError);
  EXPECT_THROW(template_from_skeleton(Skeleton{}), InputError);
  EXPECT_THROW(template_from_skeleton(skeleton_from_joints({{0, 0, 0}, {0, 0, 0}}, {-1, 0})), InputError);
}

TEST(EmbeddingTemplate, ALoneChainIsATemplate) {
  const TemplateSkeleton snake = template_from_skeleton(
      skeleton_from_joints({{0, -0.4, 0}, {0, -0.1, 0}, {0, 0.1, 0}, {0, 0.4, 0}}, {-1, 0, 1, 2}));
  const Mesh mesh = test::capsule_mesh({{{0, -0.45, 0}, {0, 0.45, 0}, 0.05}});
  const auto joints = embed_skeleton(mesh, snake).skeleton.positions();
  ASSERT_EQ(joints.size(), 4u);
  EXPECT_LT(joints[0].y(), -0.3);
  EXPECT_GT(joints[3].y(), 0.3);
  for (const Eigen::Vector3d& joint : joints) EXPECT_LT(std::hypot(joint.x(), joint.z()), 0.02);
}

}  // namespace
}  // namespace anigen::rig
