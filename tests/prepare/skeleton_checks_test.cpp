#include "anigen/prepare/skeleton_checks.h"

#include <gtest/gtest.h>

#include "anigen/core/random.h"
#include "anigen/prepare/import_asset.h"
#include "anigen/prepare/metadata.h"

namespace anigen::prepare {
namespace {

TEST(ClosestBones, ComparesVectorsFromTheParentOfAllButTheRoot) {
  const std::vector<int> parents = {-1, 0, 0, 1};
  // Mirrored limbs differ; a root at the origin is not compared with a bone of no length.
  EXPECT_NEAR(closest_bones({{0, 0, 0}, {0, 0, 0}, {-0.1f, 0, 0}, {0.1f, 0, 0.2f}}, parents), 0.1, 1e-7);
  // Joint 3 repeats the vector of joint 1 elsewhere.
  EXPECT_NEAR(closest_bones({{0, 0, 0}, {0.1f, 0, 0}, {-0.1f, 0, 0}, {0.2f, 0, 0}}, parents), 0.0, 1e-7);
  EXPECT_EQ(closest_bones({{0, 0, 0}, {0.1f, 0, 0}}, {-1, 0}), kNoPair);
}

TEST(ClosestBones, AgreesWithComparingAllPairs) {
  Rng rng(1, "closest bones");
  std::vector<Eigen::Vector3f> joints(1, Eigen::Vector3f::Zero());
  std::vector<int> parents = {-1};
  for (int j = 1; j < 60; ++j) {
    parents.push_back(0);
    joints.emplace_back(0.01f * static_cast<float>(rng.index(4)), static_cast<float>(rng.uniform()),
                        static_cast<float>(rng.uniform()));
  }
  double expected = kNoPair;
  for (std::size_t a = 1; a < joints.size(); ++a) {
    for (std::size_t b = 1; b < a; ++b) {
      expected = std::min(expected, static_cast<double>((joints[a] - joints[b]).cwiseAbs().maxCoeff()));
    }
  }
  EXPECT_NEAR(closest_bones(joints, parents), expected, 1e-7);
}

TEST(Quality, FollowsTheLimits) {
  AssetRecord record;
  record.num_joints = 3;
  record.num_vertices = 1000;
  record.closest_bones = 2e-6;
  const QualityLimits limits;
  EXPECT_TRUE(usable(record, limits));
  record.num_joints = 2;
  EXPECT_FALSE(usable(record, limits));
  record.num_joints = 100;
  EXPECT_TRUE(usable(record, limits));
  record.num_joints = 101;
  EXPECT_FALSE(usable(record, limits));
  record.num_joints = 50;
  record.closest_bones = 1e-6;
  EXPECT_FALSE(usable(record, limits));

  record.invented_rows = 10;
  EXPECT_FALSE(bad_skin(record, limits));
  record.invented_rows = 11;
  EXPECT_TRUE(bad_skin(record, limits));
}

TEST(Quality, InventedRowsAreReadFromTheImportNotes) {
  EXPECT_EQ(invented_rows({{"nan_weights", "6 vertices had weights that are not numbers"},
                           {"unnormalised_weights", "100 vertices"},
                           {"zero_weights", "4 vertices had no weight"}}),
            10u);
}

}  // namespace
}  // namespace anigen::prepare
