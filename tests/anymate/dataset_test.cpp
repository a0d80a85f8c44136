#include "anigen/anymate/dataset.h"

#include <gtest/gtest.h>

#include <set>

#include "anigen/core/error.h"
#include "anigen/geometry/primitives.h"
#include "tests/data/synthetic_dataset.h"
#include "tests/support/paths.h"

namespace anigen::anymate {
namespace {

using Points = std::vector<Eigen::Vector3f>;

// One point per row, each wholly on one joint.
SkinWeights rigid(const std::vector<int>& joints) {
  SkinWeights skin;
  for (const int joint : joints) skin.append_row({{joint, 1.0f}});
  return skin;
}

TEST(BoneLayout, AChainEndsWhereItsWeightsAre) {
  const Points joints = {{0, 0, 0}, {0, 1, 0}}, points = {{0.1f, 0.5f, 0}, {0, 1.4f, 0}, {0, 2.2f, 0}};
  const BoneLayout layout = lay_out_bones(joints, {-1, 0}, {true, true}, points, rigid({0, 1, 1}));
  ASSERT_EQ(layout.heads.size(), 2u);
  EXPECT_EQ(layout.tails[0], joints[1]) << "one child: the bone ends at it";
  // The mean of 1.4 and 2.2 is 0.8 above the head; a quarter more is 1.0.
  EXPECT_LT((layout.tails[1] - Eigen::Vector3f(0, 2, 0)).norm(), 1e-6f);
  EXPECT_EQ(layout.joints.size(), 3u) << "two heads and one tail that is no head";
  EXPECT_EQ(layout.conns, (std::vector<int>{0, 0, 1}));
}

TEST(BoneLayout, AForkHasALinkThatIsNoBone) {
  const Points joints = {{0, 0, 0}, {-1, 1, 0}, {1, 1, 0}};
  const Points points = {{0, 0.4f, 0}, {-2, 1, 0}, {2, 1, 0}};
  const BoneLayout layout = lay_out_bones(joints, {-1, 0, 0}, {true, true, true}, points, rigid({0, 1, 2}));
  ASSERT_EQ(layout.joints.size(), 6u);
  EXPECT_LT((layout.tails[0] - Eigen::Vector3f(0, 0.5f, 0)).norm(), 1e-6f) << "several children: towards the weights";
  // 0 to 2 are heads, 3 is the fork's own end, under which both children hang.
  EXPECT_EQ(layout.conns, (std::vector<int>{0, 3, 3, 0, 1, 2}));
}

TEST(BoneLayout, WhatNothingHangsOnGoesAway) {
  const Points joints = {{0, 0, 0}, {0, 1, 0}, {0, 2, 0}}, points = {{0, 0.5f, 0}, {0, 2.5f, 0}};
  const BoneLayout within = lay_out_bones(joints, {-1, 0, 1}, {true, false, true}, points, rigid({0, 2}));
  EXPECT_EQ(within.bone_of, (std::vector<int>{0, -1, 1}));
  EXPECT_EQ(within.tails[0], joints[2]) << "the child of the removed one";
  // A root with two children: the one nearest to their middle takes its place.
  const Points fork = {{0, 0, 0}, {-1, 0, 0}, {3, 0, 0}, {1.5f, 0, 0}};
  const Points on = {{-2, 0, 0}, {4, 0, 0}, {1.5f, 1, 0}};
  const BoneLayout root = lay_out_bones(fork, {-1, 0, 0, 0}, {false, true, true, true}, on, rigid({1, 2, 3}));
  EXPECT_EQ(root.heads.size(), 3u);
  std::size_t roots = 0;
  for (std::size_t j = 0; j < root.conns.size(); ++j) roots += root.conns[j] == static_cast<int>(j) ? 1 : 0;
  EXPECT_EQ(roots, 1u);
  EXPECT_EQ(root.conns[2], 2) << "the joint at 1.5";
  EXPECT_THROW(lay_out_bones(joints, {-1, 0, 1}, {false, false, false}, points, rigid({0, 2})), InputError);
}

TEST(BoneLayout, TwoBonesWithOneEndAreRejected) {
  const Points joints = {{0, 0, 0}, {5, 0, 0}, {1, 1, 0}, {1, 1, 0}};
  const Points points = {{0.5f, 0, 0}, {1.5f, 0, 0}, {0, 3, 0}, {1, 3, 0}};
  EXPECT_THROW(lay_out_bones(joints, {-1, -1, 0, 1}, {true, true, true, true}, points, rigid({0, 1, 2, 3})),
               InputError);
}

TEST(AnymateMesh, FrameIsTheBoxYUpAndBack) {
  const Points corners = {{1, 2, 3}, {5, 2, 3}, {1, 4, 3}, {1, 2, 4}};
  const AnymateFrame frame = AnymateFrame::of(corners);
  EXPECT_LT((frame.into({5, 4, 4}) - Eigen::Vector3d(1.0, 0.25, -0.5)).norm(), 1e-12);
  EXPECT_LT((frame.out_of(frame.into({1.5, 2.5, 3.5})) - Eigen::Vector3d(1.5, 2.5, 3.5)).norm(), 1e-12);
  EXPECT_THROW(AnymateFrame::of({{1, 1, 1}, {1, 1, 1}}), InputError);
  EXPECT_THROW(anymate_mesh(corners, {}), InputError);
  EXPECT_THROW(anymate_mesh(corners, {{0, 1, 4}}), InputError);
}

TEST(AnymateMesh, CellsOfABallFillIt) {
  const Mesh ball = geometry::icosphere(4, 0.5);
  const torch::Tensor cells = solid_cells(anymate_mesh(ball.vertices, ball.faces));
  // The ball of radius 1 holds 4/3 π 32³ cells of side 1/32; its walls add up to half of a layer of 4 π 32² cells.
  const double inside = 4.0 / 3.0 * 3.14159265 * 32 * 32 * 32, layer = 4.0 * 3.14159265 * 32 * 32;
  EXPECT_GT(static_cast<double>(cells.size(0)), inside - 0.3 * layer);
  EXPECT_LT(static_cast<double>(cells.size(0)), inside + 1.0 * layer);
}

class AnymateData : public ::testing::Test {
 protected:
  void SetUp() override { test::write_synthetic_dataset(folder_.path(), 6); }
  AnymateDatasetOptions options(std::size_t points) {
    AnymateDatasetOptions options;
    options.data_dir = folder_.path().string();
    options.points = points;
    return options;
  }
  test::TemporaryFolder folder_;
};

TEST_F(AnymateData, ConvertedSamplesFitTogether) {
  const AnymateDatasets sets = open_anymate(options(200), 1);
  ASSERT_EQ(sets.train->samples(), 6u);
  EXPECT_EQ(sets.held_out, nullptr);
  for (std::size_t i = 0; i < 6; ++i) {
    const AnymateSample sample = sets.train->sample(i);
    EXPECT_EQ(sample.points_cloud.sizes(), (std::vector<std::int64_t>{200, 6}));
    EXPECT_LE(sample.points_cloud.narrow(1, 0, 3).abs().max().item<double>(), 1.0 + 1e-5);
    EXPECT_LT((sample.points_cloud.narrow(1, 3, 3).norm(2, 1) - 1.0).abs().max().item<double>(), 1e-5);
    const AnymateBatch batch = collate({sample});
    EXPECT_LT((batch.skins[0].sum(1) - 1.0).abs().max().item<double>(), 1e-5) << "rows of our rigs sum to 1";
    EXPECT_EQ((batch.conns[0].sum(1) > 0).sum().item<std::int64_t>(), sample.joints.size(0)) << "everyone has a parent";
  }
}

TEST_F(AnymateData, DrawsDependOnTheirPositionAlone) {
  AnymateDatasetOptions fewer = options(64);
  const AnymateDatasets sets = open_anymate(fewer, 1);
  std::vector<AnymateSample> samples;
  for (std::size_t i = 0; i < sets.train->samples(); ++i) samples.push_back(sets.train->sample(i));
  const AnymateDataset dataset(samples, std::vector<std::size_t>(samples.size(), 1), 16, 9);
  const auto rows = [&](std::vector<data::Draw> draws) {
    const auto batch = dataset.load(draws);
    return dynamic_cast<const AnymateDraws&>(*batch).samples.back().points_cloud;
  };
  EXPECT_TRUE(torch::equal(rows({{2, 5}}), rows({{1, 4}, {2, 5}})));
  EXPECT_FALSE(torch::equal(rows({{2, 5}}), rows({{2, 6}})));
  EXPECT_EQ(rows({{0, 0}}).size(0), 16);
}

TEST_F(AnymateData, WhatIsTooLargeIsLeftOutAndNothingLeftIsAnError) {
  AnymateDatasetOptions small = options(32);
  small.max_bones = 6;
  EXPECT_LT(open_anymate(small, 1).train->samples(), 6u);
  small.max_bones = 2;
  EXPECT_THROW(open_anymate(small, 1), InputError);
}

}  // namespace
}  // namespace anigen::anymate
