#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/lint/finding.h"
#include "anigen/lint/name_checks.h"
#include "anigen/lint/pose_checks.h"
#include "anigen/lint/weight_checks.h"
#include "anigen/lint/welded_rig.h"
#include "tests/lint/doll.h"

namespace anigen::lint {
namespace {

// Shares and one rotation are linear blend skinning of a pose in which one joint is turned.
TEST(TurnedPlaces, AgreeWithSkinning) {
  const Asset doll = test::Doll().asset;
  const WeldedRig rig(doll);
  const auto spine = static_cast<std::size_t>(test::joint_named(doll, "spine"));
  for (const JointTurn& turn : turns_of_joint(rig, spine)) {
    EXPECT_NEAR(turn.axis.norm(), 1.0, 1e-12);
    EXPECT_NEAR(turn.axis.z(), 0.0, 0.05);  // across a bone that goes up
    const Eigen::Vector3d center = rig.joints[spine];
    Eigen::Affine3d motion =
        Eigen::Translation3d(center) * Eigen::AngleAxisd(turn.angle, turn.axis) * Eigen::Translation3d(-center);
    std::vector<Eigen::Matrix4d> world = doll.skeleton.bind;
    std::vector<bool> below(world.size(), false);
    for (std::size_t j = spine; j < world.size(); ++j) {
      below[j] = j == spine || below[static_cast<std::size_t>(doll.skeleton.parents[j])];
      if (below[j]) world[j] = motion.matrix() * world[j];
    }
    const std::vector<Eigen::Vector3f> skinned = skin_vertices(doll, world);
    const std::vector<Eigen::Vector3f> turned = turned_places(rig, turn, shares_moved(rig, spine));
    ASSERT_EQ(turned.size(), skinned.size());  // the doll has no seams
    for (std::size_t v = 0; v < turned.size(); ++v) ASSERT_LT((turned[v] - skinned[v]).norm(), 1e-5f) << v;
  }
}

TEST(WeldedRig, KeepsTouchingPartsOfOtherWeightsApart) {
  Asset asset;
  asset.mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 0}, {1, 0, 0}, {0, 0, 1}};
  asset.mesh.faces = {{0, 1, 2}, {3, 4, 5}};
  asset.skeleton = skeleton_from_joints({{0, 0, 0}, {1, 0, 0}}, {-1, 0}, {"a", "b"});
  for (std::size_t v = 0; v < 6; ++v) asset.skin.append_row({{v < 3 ? 0 : 1, 1.0f}});
  const WeldedRig apart(asset);
  EXPECT_EQ(apart.places.size(), 6U);
  EXPECT_EQ(apart.twins.size(), 2U);
  EXPECT_EQ(apart.shell_count, 1U);

  asset.skin = SkinWeights();
  for (std::size_t v = 0; v < 6; ++v) asset.skin.append_row({{0, 1.0f}});
  const WeldedRig whole(asset);
  EXPECT_EQ(whole.places.size(), 4U);
  EXPECT_TRUE(whole.twins.empty());
  EXPECT_EQ(whole.place_of_face(1, 0).index, 1U);
}

TEST(Findings, AreCountedByTheirSeverity) {
  EXPECT_EQ(parse_severity("warning"), Severity::kWarning);
  EXPECT_EQ(to_string(Severity::kError), "error");
  EXPECT_THROW(parse_severity("fatal"), InputError);
  RigLint lint;
  lint.findings = {{"a", Severity::kError, 1, 0.5, {"vertex", 3, "", {1, NAN, 0}}, "x"},
                   {"b", Severity::kNote, 1, 0.5, {}, "y"}};
  EXPECT_EQ(lint.count(Severity::kNote), 2U);
  EXPECT_EQ(lint.count(Severity::kWarning), 1U);
  EXPECT_EQ(lint.find("c"), nullptr);
  const Json json = to_json(lint);
  EXPECT_TRUE(json["findings"][0]["place"]["position"][1].is_null());
  EXPECT_FALSE(json["findings"][1].contains("place"));
}

TEST(Rows, AreReadableWhenOffsetsAscend) {
  SkinWeights skin;
  EXPECT_TRUE(rows_are_readable(skin));
  skin.append_row({{0, 1.0f}});
  EXPECT_TRUE(rows_are_readable(skin));
  skin.offsets.push_back(0);
  EXPECT_FALSE(rows_are_readable(skin));
  skin.offsets.clear();
  EXPECT_FALSE(rows_are_readable(skin));
}

}  // namespace
}  // namespace anigen::lint
