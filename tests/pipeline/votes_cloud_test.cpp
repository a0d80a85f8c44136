#include "anigen/pipeline/votes_cloud.h"

#include <gtest/gtest.h>

#include <limits>

#include "anigen/asset/validate.h"
#include "anigen/core/error.h"
#include "anigen/io/gltf.h"
#include "anigen/io/ply.h"
#include "anigen/raytrace/palette.h"
#include "tests/support/paths.h"

namespace anigen::pipeline {
namespace {

fields::SkeletonField three_votes() {
  fields::SkeletonField field;
  field.joints = torch::tensor({{0.0F, 0.0F, 0.0F}, {0.1F, 0.2F, 0.3F}, {-0.4F, 0.0F, 0.0F}});
  field.parents = torch::tensor({{0.5F, 0.0F, 0.0F}, {0.0F, 0.5F, 0.0F}, {0.0F, 0.0F, 0.5F}});
  field.conf_j = torch::tensor({{0.0F}, {0.6F}, {1.0F}});
  field.conf_p = torch::tensor({{0.2F}, {0.1F}, {0.9F}});
  return field;
}

TEST(VotesCloud, HasAPointPerConfidentVote) {
  VotesCloudOptions options;
  EXPECT_EQ(votes_cloud(three_votes(), options).vertices.size(), 3u);
  options.least_confidence = 0.5F;
  const Mesh joints = votes_cloud(three_votes(), options);
  ASSERT_EQ(joints.vertices.size(), 2u);
  EXPECT_EQ(joints.vertices[0], Eigen::Vector3f(0.1F, 0.2F, 0.3F));
  EXPECT_NE(joints.colors[0], joints.colors[1]);
  options.shown = VotesShown::kParents;
  const Mesh parents = votes_cloud(three_votes(), options);
  ASSERT_EQ(parents.vertices.size(), 1u);
  EXPECT_EQ(parents.vertices[0], Eigen::Vector3f(0.0F, 0.0F, 0.5F));
}

TEST(VotesCloud, PlyHoldsPointsWithTheColoursOfTheScreen) {
  const test::TemporaryFolder folder;
  write_votes(folder / "votes.ply", three_votes());
  const Mesh cloud = io::read_ply(folder / "votes.ply");
  ASSERT_EQ(cloud.vertices.size(), 3u);
  EXPECT_TRUE(cloud.faces.empty());
  // 8 bits and back through linear light.
  EXPECT_LT((cloud.colors[1].head<3>() - raytrace::heat_color(0.6F)).cwiseAbs().maxCoeff(), 0.003F);
}

TEST(VotesCloud, GlbHoldsAnOctahedronPerVote) {
  const Asset asset = votes_asset(three_votes());
  EXPECT_EQ(validate(asset), std::vector<std::string>{});
  ASSERT_EQ(asset.mesh.faces.size(), 24u);
  for (std::size_t f = 0; f < asset.mesh.faces.size(); ++f) {
    const Triangle& face = asset.mesh.faces[f];
    Eigen::Vector3f corners[3];
    for (std::size_t k = 0; k < 3; ++k) corners[k] = asset.mesh.vertices[static_cast<std::size_t>(face[k])];
    const Eigen::Vector3f center = asset.mesh.vertices[6 * (f / 8)] - Eigen::Vector3f(0.002F, 0, 0);
    const Eigen::Vector3f normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    EXPECT_GT(normal.dot(corners[0] - center), 0.0F) << "face " << f << " looks inwards";
  }
  const test::TemporaryFolder folder;
  write_votes(folder / "votes.glb", three_votes());
  EXPECT_EQ(io::read_gltf(folder / "votes.glb").asset.mesh.vertices.size(), 18u);
}

TEST(VotesCloud, RefusesBadVotesAndFiles) {
  const test::TemporaryFolder folder;
  fields::SkeletonField bad = three_votes();
  bad.joints[1][2] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(votes_cloud(bad), InputError);
  EXPECT_THROW(write_votes(folder / "votes.obj", three_votes()), InputError);
  VotesCloudOptions none;
  none.least_confidence = 2.0F;
  EXPECT_THROW(write_votes(folder / "votes.ply", three_votes(), none), InputError);
  EXPECT_THROW(write_votes(folder / "votes.glb", three_votes(), none), InputError);
  none.radius = 0.0F;
  EXPECT_THROW(votes_asset(three_votes(), none), InputError);
}

}  // namespace
}  // namespace anigen::pipeline
