#include "anigen/rigging/skeleton_edits.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "anigen/core/error.h"
#include "tests/rigging/embedding_bodies.h"

namespace anigen::rigging {
namespace {

using Points = std::vector<Eigen::Vector3d>;

/// Hips, chest with head, arms of three joints, legs of three; a tail of two. In the middle: x = 1.
Skeleton tailed_person() {
  const Points positions{{1, 0, 1},     {1, 0, 1.5},   {1, 0, 1.8},   {1.2, 0, 1.5}, {1.5, 0, 1.5}, {1.8, 0, 1.5},
                         {0.8, 0, 1.5}, {0.5, 0, 1.5}, {0.2, 0, 1.5}, {1.1, 0, 0.9}, {1.1, 0, 0.5}, {1.1, 0, 0},
                         {0.9, 0, 0.9}, {0.9, 0, 0.5}, {0.9, 0, 0},   {1, 0.3, 1},   {1, 0.6, 1}};
  const std::vector<int> parents{-1, 0, 1, 1, 3, 4, 1, 6, 7, 0, 9, 10, 0, 12, 13, 0, 15};
  return skeleton_from_joints(positions, parents, joint_names(positions, parents));
}

Skeleton named(const Skeleton& skeleton, const std::vector<std::string>& names) {
  return skeleton_from_joints(skeleton.positions(), skeleton.parents, names);
}

void expect_sound(const Skeleton& skeleton) {
  ASSERT_EQ(skeleton.parents.front(), -1);
  for (std::size_t j = 1; j < skeleton.size(); ++j) {
    EXPECT_GE(skeleton.parents[j], 0);
    EXPECT_LT(skeleton.parents[j], static_cast<int>(j));
  }
  EXPECT_EQ(std::set<std::string>(skeleton.names.begin(), skeleton.names.end()).size(), skeleton.size());
}

bool has_joint(const Skeleton& skeleton, const Eigen::Vector3d& place, double near = 1e-9) {
  const Points positions = skeleton.positions();
  return std::any_of(positions.begin(), positions.end(), [&](const auto& p) { return (p - place).norm() <= near; });
}

/// Every joint has its image across x = middle.
void expect_mirrored(const Skeleton& skeleton, double middle) {
  for (Eigen::Vector3d place : skeleton.positions()) {
    place.x() = 2.0 * middle - place.x();
    EXPECT_TRUE(has_joint(skeleton, place, 1e-9)) << place.transpose();
  }
}

TEST(JointCount, IsMetExactlyAndKeepsTheShape) {
  for (const std::size_t count : {1U, 2U, 5U, 9U, 16U, 17U, 18U, 23U, 60U}) {
    const Skeleton edited = with_joint_count(tailed_person(), count);
    EXPECT_EQ(edited.size(), count);
    expect_sound(edited);
  }
  const Skeleton nine = with_joint_count(tailed_person(), 9);
  EXPECT_TRUE(has_joint(nine, {1.8, 0, 1.5}));  // hands and feet stay, joints inside straight limbs go
  EXPECT_TRUE(has_joint(nine, {0.2, 0, 1.5}));
  EXPECT_TRUE(has_joint(nine, {1.1, 0, 0}));
  EXPECT_TRUE(has_joint(nine, {0.9, 0, 0}));
  EXPECT_THROW(with_joint_count(tailed_person(), 0), InputError);
  EXPECT_THROW(with_joint_count(skeleton_from_joints({{0, 0, 0}}, {-1}), 2), InputError);
}

TEST(JointCount, ChangesBothSidesAlike) {
  for (const std::size_t count : {7U, 11U, 13U, 15U, 19U, 25U, 40U}) {
    SCOPED_TRACE(count);
    expect_mirrored(with_joint_count(tailed_person(), count), 1.0);
  }
}

TEST(JointCount, NamesThatAreNotOursStay) {
  std::vector<std::string> names(17);
  for (std::size_t j = 0; j < names.size(); ++j) names[j] = "bone" + std::to_string(j);
  const Skeleton fewer = with_joint_count(named(tailed_person(), names), 12);
  for (const std::string& name : fewer.names) EXPECT_EQ(name.rfind("bone", 0), 0U);
  const Skeleton more = with_joint_count(named(tailed_person(), names), 19);
  for (const std::string& name : names) EXPECT_EQ(std::count(more.names.begin(), more.names.end(), name), 1) << name;
  expect_sound(more);
}

TEST(MirroredSkeleton, OfASymmetricOneIsItself) {
  const Skeleton before = tailed_person(), after = mirrored_skeleton(before, 1.0, 2.5);
  EXPECT_EQ(after.parents, before.parents);
  EXPECT_EQ(after.names, before.names);
  for (std::size_t j = 0; j < before.size(); ++j)
    EXPECT_LT((after.positions()[j] - before.positions()[j]).norm(), 1e-12);
}

TEST(MirroredSkeleton, EvensOutSmallDifferencesAndStraightensATail) {
  Points positions = tailed_person().positions();
  positions[5] += Eigen::Vector3d(0.04, 0.02, -0.04);  // one hand
  positions[2].x() += 0.05;                            // head
  positions[16].x() += 0.4;                            // end of the tail, bent aside
  const Skeleton after = mirrored_skeleton(skeleton_from_joints(positions, tailed_person().parents), 1.0, 2.5);
  ASSERT_EQ(after.size(), 17U);
  expect_mirrored(after, 1.0);
  EXPECT_TRUE(has_joint(after, {1.82, 0.01, 1.48}));
  EXPECT_TRUE(has_joint(after, {1.0, 0.6, 1.0}));
}

TEST(MirroredSkeleton, CopiesABranchOfOneSideWithTheOtherSidesName) {
  Points positions = tailed_person().positions();
  std::vector<int> parents = tailed_person().parents;
  std::vector<std::string> names(17);
  for (std::size_t j = 0; j < names.size(); ++j) names[j] = "bone" + std::to_string(j);
  names[3] = "UpperArm_L", names[4] = "LowerArm_L", names[5] = "Hand_L";
  for (int gone = 0; gone < 3; ++gone) {  // the other arm
    positions.erase(positions.begin() + 6);
    parents.erase(parents.begin() + 6);
    names.erase(names.begin() + 6);
  }
  for (int& parent : parents) parent -= parent > 6 ? 3 : 0;
  const Skeleton after = mirrored_skeleton(skeleton_from_joints(positions, parents, names), 1.0, 2.5);
  ASSERT_EQ(after.size(), 17U);
  expect_sound(after);
  expect_mirrored(after, 1.0);
  for (const char* name : {"UpperArm_R", "LowerArm_R", "Hand_R"}) {
    const auto found = std::find(after.names.begin(), after.names.end(), name);
    ASSERT_NE(found, after.names.end()) << name;
    EXPECT_LT(after.positions()[static_cast<std::size_t>(found - after.names.begin())].x(), 1.0);
  }
}

TEST(ExtendedSkeleton, AddsABranchWhereThereIsNoBone) {
  const Mesh mesh = test::capsule_mesh({{{0, 0, 0}, {0, 0, 2}, 0.15}, {{0, 0, 1}, {0, 1.5, 1}, 0.1}});
  const Skeleton own = skeleton_from_joints({{0, 0, 0}, {0, 0, 1}, {0, 0, 2}}, {-1, 0, 1}, {"a", "b", "c"});
  const Skeleton curve = skeleton_from_joints(
      {{0.02, 0, 1}, {0, 0, 2}, {0, 0, 0.1}, {0, 0.6, 1}, {0, 1.0, 1}, {0, 1.5, 1}}, {-1, 0, 0, 0, 3, 4});
  const Skeleton after = extended_skeleton(own, curve, mesh);
  ASSERT_EQ(after.size(), 6U);
  expect_sound(after);
  for (std::size_t j = 0; j < own.size(); ++j) {
    EXPECT_EQ(after.names[j], own.names[j]);
    EXPECT_EQ(after.parents[j], own.parents[j]);
    EXPECT_EQ(after.positions()[j], own.positions()[j]);
  }
  EXPECT_EQ(after.names[3], "added_1_00");
  EXPECT_EQ(after.parents[3], 1);
  EXPECT_EQ(after.parents[5], 4);
  EXPECT_LT((after.positions()[5] - Eigen::Vector3d(0, 1.5, 1)).norm(), 1e-12);
  EXPECT_EQ(extended_skeleton(own, own, mesh).size(), own.size());
  EXPECT_EQ(extended_skeleton(after, curve, mesh).size(), after.size());
}

}  // namespace
}  // namespace anigen::rigging
