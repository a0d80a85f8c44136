#include <gtest/gtest.h>
#include <limits>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/generate/assemble.h"
#include "anigen/generate/finishing.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/ply.h"
#include "anigen/render/picture.h"
#include "tests/support/paths.h"

namespace anigen::generate {

namespace {

using torch::Tensor;

/// A tetrahedron with three joints: a cycle 0 ⇄ 1 beside the root 2, so that columns move.
struct DecodedTetrahedron {
  shape_field::ExtractedMesh mesh;
  skeleton_field::SkeletonTensors skeleton;
  Tensor weights;

  DecodedTetrahedron() {
    mesh.success = true;
    mesh.vertices = torch::tensor({{0.0F, 0.0F, 0.0F}, {0.4F, 0.0F, 0.0F}, {0.0F, 0.4F, 0.0F}, {0.0F, 0.0F, 0.4F}});
    mesh.faces = torch::tensor({{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}, torch::kInt64);
    mesh.attributes = torch::full({4, 6}, 0.5F);
    mesh.attributes[1] = torch::tensor({1.0F, 0.0F, 2.0F, 0.0F, 0.0F, 1.0F});
    skeleton.joints = torch::tensor({{0.0F, 0.0F, 0.3F}, {0.0F, 0.0F, 0.2F}, {0.0F, 0.0F, 0.1F}});
    skeleton.parents = torch::tensor({1, 0, -1}, torch::kInt64);
    weights = torch::tensor({{0.7F, 0.29996F, 0.00004F}, {0.0F, 1.0F, 0.0F}, {0.2F, 0.3F, 0.5F}, {0.0F, 0.0F, 1.0F}});
  }

  Asset asset() const { return decoded_asset(mesh, skeleton, weights); }
};

std::string refusal_place(const DecodedTetrahedron& decoded) {
  try {
    decoded.asset();
  } catch (const InputError& error) {
    return error.place();
  }
  return "accepted";
}

float weight_of(const SkinWeights& skin, std::size_t vertex, int joint) {
  for (std::size_t i = 0; i < skin.row_size(vertex); ++i) {
    if (skin.row(vertex)[i].joint == joint) return skin.row(vertex)[i].weight;
  }
  return 0.0F;
}

TEST(DecodedAsset, IsASoundAssetWithOneTree) {
  const Asset asset = DecodedTetrahedron().asset();
  EXPECT_EQ(validate(asset), std::vector<std::string>{});
  // Joint 1 is nearer to joint 2 and goes to it; joint 0 stays below joint 1: decoded 2, 1, 0.
  EXPECT_EQ(asset.skeleton.parents, (std::vector<int>{-1, 0, 1}));
  EXPECT_EQ(asset.skeleton.names, (std::vector<std::string>{"chain_0_00", "chain_0_01", "chain_0_02"}));
  EXPECT_NEAR(asset.skeleton.positions()[0].z(), 0.1, 1e-6);
  EXPECT_NEAR(asset.skeleton.positions()[2].z(), 0.3, 1e-6);
}

TEST(DecodedAsset, WeightsFollowTheirJointsAndLoseTheirTails) {
  const Asset asset = DecodedTetrahedron().asset();
  EXPECT_EQ(asset.skin.row_size(0), 2u);  // 0.00004 is below the threshold
  EXPECT_NEAR(weight_of(asset.skin, 0, 2), 0.7 / 0.99996, 1e-6);
  EXPECT_NEAR(weight_of(asset.skin, 0, 1), 0.29996 / 0.99996, 1e-6);
  EXPECT_EQ(weight_of(asset.skin, 1, 1), 1.0F);
  EXPECT_NEAR(weight_of(asset.skin, 2, 0), 0.5, 1e-6);
  EXPECT_EQ(weight_of(asset.skin, 3, 0), 1.0F);
}

TEST(DecodedAsset, AThresholdAboveAllLeavesTheHeaviest) {
  const DecodedTetrahedron decoded;
  DecodedAssetOptions options;
  options.least_weight = 0.9F;
  const Asset asset = decoded_asset(decoded.mesh, decoded.skeleton, decoded.weights, options);
  for (std::size_t v = 0; v < 4; ++v) EXPECT_EQ(asset.skin.row_size(v), 1u);
  EXPECT_EQ(weight_of(asset.skin, 0, 2), 1.0F);
  EXPECT_EQ(weight_of(asset.skin, 2, 0), 1.0F);
}

TEST(DecodedAsset, ChunksGiveTheSameAsset) {
  const DecodedTetrahedron decoded;
  DecodedAssetOptions options;
  options.chunk = 3;
  std::vector<std::int64_t> asked;
  const Asset asset = decoded_asset(
      decoded.mesh, decoded.skeleton,
      [&](std::int64_t begin, std::int64_t end) {
        asked.insert(asked.end(), {begin, end});
        return decoded.weights.slice(0, begin, end);
      },
      options);
  EXPECT_EQ(asked, (std::vector<std::int64_t>{0, 3, 3, 4}));
  EXPECT_EQ(to_dense(asset.skin, 3), to_dense(decoded.asset().skin, 3));
}

TEST(DecodedAsset, ColoursBecomeLinearAndNormalsPointOut) {
  const Asset asset = DecodedTetrahedron().asset();
  EXPECT_NEAR(asset.mesh.colors[0].x(), 0.21404F, 1e-4F);                                     // sRGB 0.5
  EXPECT_LT((asset.mesh.colors[1] - Eigen::Vector4f(1.0F, 0.0F, 1.0F, 1.0F)).norm(), 1e-6F);  // blue was 2
  EXPECT_LT(asset.mesh.normals[0].maxCoeff(), 0.0F);
  DecodedTetrahedron grey;
  grey.mesh.attributes = Tensor();
  EXPECT_TRUE(grey.asset().mesh.colors.empty());
}

TEST(DecodedAsset, ComesBackFromAGlb) {
  const test::TemporaryFolder folder;
  const Asset asset = DecodedTetrahedron().asset();
  io::write_gltf(folder / "decoded.glb", asset);
  const Asset back = io::read_gltf(folder / "decoded.glb").asset;
  ASSERT_EQ(back.mesh.vertices.size(), asset.mesh.vertices.size());
  for (std::size_t i = 0; i < asset.mesh.vertices.size(); ++i) {  // both are in the bind pose, up to its rounding
    EXPECT_LT((back.mesh.vertices[i] - asset.mesh.vertices[i]).norm(), 1e-6F) << "vertex " << i;
  }
  EXPECT_EQ(back.skeleton.names, asset.skeleton.names);
  EXPECT_EQ(back.skeleton.parents, asset.skeleton.parents);
  const std::vector<float> before = to_dense(asset.skin, 3), after = to_dense(back.skin, 3);
  ASSERT_EQ(after.size(), before.size());
  for (std::size_t i = 0; i < after.size(); ++i) EXPECT_NEAR(after[i], before[i], 1e-6F);
}

TEST(DecodedAsset, RefusesWhatIsNotSound) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(refusal_place(DecodedTetrahedron()), "accepted");
  DecodedTetrahedron bad;
  bad.mesh.vertices[2][0] = nan;
  EXPECT_EQ(refusal_place(bad), "vertices[2]");
  bad = DecodedTetrahedron();
  bad.mesh.faces[1][2] = 4;
  EXPECT_EQ(refusal_place(bad), "faces[1]");
  bad = DecodedTetrahedron();
  bad.mesh.attributes[3][2] = nan;
  EXPECT_EQ(refusal_place(bad), "attributes[3]");
  bad = DecodedTetrahedron();
  bad.skeleton.joints[1][0] = nan;
  EXPECT_EQ(refusal_place(bad), "joints[1]");
  bad = DecodedTetrahedron();
  bad.weights[2][1] = nan;
  EXPECT_EQ(refusal_place(bad), "weights[2]");
  bad = DecodedTetrahedron();
  bad.weights[3].zero_();
  EXPECT_EQ(refusal_place(bad), "weights[3]");
  bad = DecodedTetrahedron();
  bad.weights = bad.weights.slice(1, 0, 2);
  EXPECT_EQ(refusal_place(bad), "weights");
  bad = DecodedTetrahedron();
  bad.weights = bad.weights.slice(0, 0, 2);
  EXPECT_EQ(refusal_place(bad), "weights");
  bad = DecodedTetrahedron();
  bad.skeleton.parents = bad.skeleton.parents.slice(0, 1);
  EXPECT_EQ(refusal_place(bad), "parents");
  bad = DecodedTetrahedron();
  bad.skeleton.joints = torch::zeros({0, 3});
  EXPECT_EQ(refusal_place(bad), "joints");
  bad = DecodedTetrahedron();
  bad.mesh.faces = torch::zeros({0, 3}, torch::kInt64);
  EXPECT_THROW(bad.asset(), InputError);
}

/// Two squares in one place that share no vertex, each with a joint of its own, and a vertex without faces.
Asset two_layers() {
  Asset asset;
  asset.skeleton = skeleton_from_joints({{0, 0, 0}, {0, 0, 0.5}}, {-1, 0}, {"lower", "upper"});
  for (std::int32_t layer = 0; layer < 2; ++layer) {
    for (const auto& [x, y] : {std::pair(0.0F, 0.0F), {0.4F, 0.0F}, {0.4F, 0.4F}, {0.0F, 0.4F}}) {
      asset.mesh.vertices.emplace_back(x, y, 0.0F);
      asset.mesh.colors.emplace_back(static_cast<float>(layer), 0.5F, 0.5F, 1.0F);
      asset.skin.append_row({{layer, 1.0F}});
    }
    asset.mesh.faces.push_back({4 * layer, 4 * layer + 1, 4 * layer + 2});
    asset.mesh.faces.push_back({4 * layer, 4 * layer + 2, 4 * layer + 3});
  }
  asset.mesh.vertices.emplace_back(0.2F, 0.2F, 0.2F);
  asset.mesh.colors.emplace_back(0.25F, 0.25F, 0.25F, 1.0F);
  asset.skin.append_row({{0, 0.5F}, {1, 0.5F}});
  return asset;
}

FinishingOptions nothing_to_finish() {
  FinishingOptions options;
  options.reduction = 0.0;
  options.remove_hidden = options.filter_skin = false;
  options.smoothing_iterations = options.texture_size = 0;
  return options;
}

// docs/reference/flows.md, 5.6: weights are transferred only when the mesh became another one.
TEST(FinishedAssets, VerticesThatStayKeepTheirOwnRows) {
  const Asset dense = two_layers();
  const Asset finished = finish_asset(dense, nothing_to_finish()).asset;
  ASSERT_EQ(finished.mesh.vertices, dense.mesh.vertices);
  EXPECT_EQ(to_dense(finished.skin, 2), to_dense(dense.skin, 2));
  EXPECT_EQ(finished.mesh.colors, dense.mesh.colors);
}

TEST(FinishedAssets, VerticesOfAnotherMeshGetWhatLiesNearest) {
  FinishingOptions options = nothing_to_finish();
  options.reduction = 0.25;
  const Asset dense = two_layers();
  const Asset finished = finish_asset(dense, options).asset;
  EXPECT_NE(finished.mesh.vertices, dense.mesh.vertices);
  ASSERT_EQ(finished.skin.rows(), finished.mesh.vertices.size());
  for (std::size_t v = 0; v < finished.skin.rows(); ++v) EXPECT_GT(finished.skin.row_size(v), 0u);
}

}  // namespace

namespace {

skeleton_field::SkeletonField three_votes() {
  skeleton_field::SkeletonField field;
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
  EXPECT_LT((cloud.colors[1].head<3>() - render::heat_color(0.6F)).cwiseAbs().maxCoeff(), 0.003F);
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
  skeleton_field::SkeletonField bad = three_votes();
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

}  // namespace anigen::generate
