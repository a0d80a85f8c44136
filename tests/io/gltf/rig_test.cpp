// Import of skeletons, bind poses and animations of hand-written files.
#include <gtest/gtest.h>

#include <cmath>

#include "anigen/asset/rigged_asset.h"
#include "tests/io/gltf/gltf_import_support.h"

namespace anigen::io {
namespace {

using test::flag;
using test::GltfBuilder;
using test::has_note;
using test::import_built;
using test::note_count;

const double kHalf = std::sqrt(0.5);

// World matrices in glTF's frame, for comparison with products of node matrices.
std::vector<Eigen::Matrix4d> y_up(const Skeleton& skeleton, const Pose& pose) {
  Eigen::Matrix4d turn;
  turn << 1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1;
  std::vector<Eigen::Matrix4d> world = forward_kinematics(skeleton.parents, pose);
  for (Eigen::Matrix4d& m : world) m = turn * m;
  return world;
}

void expect_matrix(const Eigen::Matrix4d& found, const Eigen::Matrix4d& expected) {
  EXPECT_LT((found - expected).cwiseAbs().maxCoeff(), 1e-6 * expected.cwiseAbs().maxCoeff()) << found;
}

Eigen::Matrix4d trs(const Eigen::Vector3d& t, const Eigen::Quaterniond& q, const Eigen::Vector3d& s) {
  return Transform{t, q, s}.matrix();
}

// The flag with a node 3 between hip and knee.
GltfBuilder flag_with_node_between(const Json& node) {
  GltfBuilder file = flag();
  file.json["nodes"][1]["children"] = {3};
  file.json["nodes"].push_back(node);
  file.json["nodes"][3]["children"] = {2};
  return file;
}

TEST(GltfImportSkeleton, PutsSeveralRootsUnderOne) {
  GltfBuilder file = flag();
  file.json["nodes"][1].erase("children");
  file.json["nodes"].push_back({{"children", {1, 2}}, {"translation", {0, 3, 4}}, {"scale", {2, 2, 2}}});
  file.json["scenes"][0]["nodes"] = {0, 3};
  const ImportedAsset imported = import_built(file);
  const Skeleton& skeleton = imported.asset.skeleton;
  EXPECT_TRUE(has_note(imported, "several_roots"));
  EXPECT_EQ(skeleton.parents, (std::vector<int>{-1, 0, 0}));
  EXPECT_EQ(skeleton.names, (std::vector<std::string>{"root", "hip", "knee"}));
  const std::vector<Eigen::Matrix4d> world = y_up(skeleton, skeleton.rest);
  const Eigen::Vector3d ancestor(0, 3, 4);
  expect_matrix(world[0], trs(ancestor, Eigen::Quaterniond::Identity(), {1, 1, 1}));
  expect_matrix(world[1], trs(ancestor, Eigen::Quaterniond::Identity(), {2, 2, 2}));
  expect_matrix(world[2], trs({0, 5, 4}, Eigen::Quaterniond::Identity(), {2, 2, 2}));

  file.json["scenes"][0]["nodes"] = {0, 1, 2};  // now without a common ancestor
  file.json["nodes"][3].erase("children");
  const Skeleton apart = import_built(file).asset.skeleton;
  expect_matrix(y_up(apart, apart.rest)[0], Eigen::Matrix4d::Identity());
}

TEST(GltfImportSkeleton, FoldsStaticNodesIntoAnimatedJointsExactly) {
  const Eigen::Quaterniond turned(kHalf, 0, 0, kHalf), other(kHalf, kHalf, 0, 0);
  GltfBuilder file =
      flag_with_node_between({{"translation", {1, 2, 3}}, {"rotation", {0, 0, kHalf, kHalf}}, {"scale", {-2, -2, -2}}});
  file.animate(2, "translation", {0, 2}, {1, 1, 1, 0, 1, 0, 0, 0, 3, 5, 0, 0, 0, 0, 1, 2, 2, 2}, "CUBICSPLINE");
  file.animate(2, "rotation", {0, 1}, {0, 0, 0, 1, static_cast<float>(kHalf), 0, 0, static_cast<float>(kHalf)});
  file.animate(2, "scale", {0, 1}, {1, 1, 1, 1, 2, 3}, "STEP");
  const ImportedAsset imported = import_built(file);
  const Asset& asset = imported.asset;
  EXPECT_EQ(note_count(imported, "folded_node"), 1u);
  ASSERT_EQ(asset.skeleton.size(), 2u);
  ASSERT_EQ(asset.animations.size(), 1u);
  EXPECT_EQ(asset.animations[0].name, "move");
  const Eigen::Matrix4d between = trs({1, 2, 3}, turned, {-2, -2, -2});
  expect_matrix(y_up(asset.skeleton, asset.skeleton.rest)[1],
                between * trs({0, 1, 0}, Eigen::Quaterniond::Identity(), {1, 1, 1}));
  // Half way: Hermite basis 1/2, 1/8, 1/2, −1/8, tangents times the span of 2.
  const Eigen::Vector3d middle = .5 * Eigen::Vector3d(0, 1, 0) + .25 * Eigen::Vector3d(0, 0, 3) +
                                 .5 * Eigen::Vector3d(0, 0, 1) - .25 * Eigen::Vector3d(5, 0, 0);
  expect_matrix(y_up(asset.skeleton, sample(asset.animations[0], asset.skeleton, 1.0))[1],
                between * trs(middle, other, {1, 2, 3}));
}

TEST(GltfImportSkeleton, PromotesAnimatedAndUnevenNodes) {
  GltfBuilder uneven = flag_with_node_between({{"name", "uneven"}, {"scale", {1, 2, 1}}});
  const ImportedAsset a = import_built(uneven);
  EXPECT_EQ(note_count(a, "promoted_node"), 1u);
  EXPECT_EQ(a.asset.skeleton.names, (std::vector<std::string>{"hip", "uneven", "knee"}));

  GltfBuilder moving = flag_with_node_between({{"name", "moving"}});
  moving.animate(3, "translation", {0, 1}, {0, 0, 0, 0, 0, 4});
  const ImportedAsset b = import_built(moving);
  ASSERT_EQ(b.asset.skeleton.size(), 3u);
  const Pose pose = sample(b.asset.animations.at(0), b.asset.skeleton, 1.0);
  expect_matrix(y_up(b.asset.skeleton, pose)[2], trs({0, 1, 4}, Eigen::Quaterniond::Identity(), {1, 1, 1}));

  GltfBuilder constant = flag_with_node_between({{"name", "constant"}});
  constant.animate(3, "translation", {0, 1}, {0, 0, 0, 0, 0, 0});
  const ImportedAsset c = import_built(constant);
  EXPECT_EQ(c.asset.skeleton.size(), 2u);
  EXPECT_EQ(note_count(c, "dropped_channels"), 1u);
  EXPECT_TRUE(c.asset.animations.empty());
}

TEST(GltfImportSkeleton, PromotesMovingNodesThatCarryMeshes) {
  GltfBuilder file = flag();
  file.json["meshes"].push_back(
      {{"primitives", Json::array({Json{{"attributes", {{"POSITION", 0}}}, {"indices", 3}}})}});
  file.json["nodes"].push_back({{"name", "arm"}, {"children", {4}}});
  file.json["nodes"].push_back({{"mesh", 1}, {"translation", {9, 0, 0}}});
  file.json["scenes"][0]["nodes"].push_back(3);
  file.animate(3, "translation", {0, 1}, {0, 0, 0, 0, 8, 0});
  const Asset asset = import_built(file).asset;
  EXPECT_EQ(asset.skeleton.names, (std::vector<std::string>{"root", "hip", "knee", "arm"}));
  const Pose pose = sample(asset.animations.at(0), asset.skeleton, 1.0);
  const std::vector<Eigen::Vector3f> moved = skin_vertices(asset, pose);
  EXPECT_LT((moved[4] - Eigen::Vector3f(8, 0, 8)).norm(), 1e-5f);
  EXPECT_LT((moved[0] - Eigen::Vector3f(-1, 0, 0)).norm(), 1e-5f);
}

TEST(GltfImportSkeleton, MissingInverseBindMatricesAreIdentities) {
  GltfBuilder file = flag();
  file.json["skins"][0].erase("inverseBindMatrices");
  const ImportedAsset imported = import_built(file);
  EXPECT_EQ(note_count(imported, "missing_inverse_bind"), 1u);
  EXPECT_LT((imported.asset.skeleton.bind[1] - imported.asset.skeleton.bind[0]).norm(), 1e-12);
  // At rest the upper vertices follow the knee, which is 1 above where it was bound.
  const std::vector<Eigen::Vector3f> rest = skin_vertices(imported.asset, imported.asset.skeleton.rest);
  EXPECT_LT((rest[3] - Eigen::Vector3f(1, 0, 3)).norm(), 1e-6f);
  EXPECT_TRUE(has_note(imported, "rest_pose_differs"));
}

TEST(GltfImportSkeleton, BindPoseStandsWhereTheRootRests) {
  // A skin made at a hundredth of the size the scene shows it in, as exporters with unit conversion write it.
  GltfBuilder file = flag();
  file.json["nodes"][1]["scale"] = {100, 100, 100};
  file.json["nodes"][1]["translation"] = {0, 7, 0};
  const Asset asset = import_built(file).asset;
  EXPECT_LT((asset.mesh.vertices[3] - Eigen::Vector3f(100, 0, 207)).norm(), 1e-3f);
  EXPECT_LT((asset.skeleton.positions()[1] - Eigen::Vector3d(0, 0, 107)).norm(), 1e-9);
}

TEST(GltfImportSkeleton, SkinsWithAnotherMeshSpaceAgree) {
  // Both skins have the knee 1 above the hip; the second one's mesh is stored half a unit higher.
  GltfBuilder file = flag();
  file.json["nodes"].push_back({{"mesh", 0}, {"skin", 1}});
  file.json["scenes"][0]["nodes"].push_back(3);
  const int inverse = file.floats({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -.5f,  0, 1,  //
                                   1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -1.5f, 0, 1},
                                  "MAT4");
  file.json["skins"].push_back({{"joints", {1, 2}}, {"inverseBindMatrices", inverse}});
  const ImportedAsset imported = import_built(file);
  EXPECT_TRUE(imported.notes.empty());
  EXPECT_LT((imported.asset.mesh.vertices[7] - Eigen::Vector3f(1, 0, 1.5f)).norm(), 1e-6f);
}

TEST(GltfImportSkeleton, SkinsThatDisagreeAreNoted) {
  GltfBuilder file = flag();
  file.json["nodes"].push_back({{"mesh", 0}, {"skin", 1}});
  file.json["scenes"][0]["nodes"].push_back(3);
  const int inverse = file.floats({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0,  0, 1,  //
                                   1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -3, 0, 1},
                                  "MAT4");
  file.json["skins"].push_back({{"joints", {1, 2}}, {"inverseBindMatrices", inverse}});
  const ImportedAsset imported = import_built(file);
  EXPECT_TRUE(has_note(imported, "bind_pose_conflict"));
  // Σ w C_j IBM_j v: the knee was bound 2 higher by the second skin.
  EXPECT_LT((imported.asset.mesh.vertices[7] - Eigen::Vector3f(1, 0, 0)).norm(), 1e-6f);
  EXPECT_LT((imported.asset.mesh.vertices[4] - Eigen::Vector3f(-1, 0, 0)).norm(), 1e-6f);
}

TEST(GltfImportSkeleton, RepairsOrRefusesSingularInverseBindMatrices) {
  GltfBuilder file = flag();
  std::vector<float> numbers(32, 0.0f);
  for (const std::size_t i : {0, 5, 10, 15}) numbers[i] = 1.0f;
  file.json["skins"][0]["inverseBindMatrices"] = file.floats(numbers, "MAT4");
  const ImportedAsset imported = import_built(file);
  EXPECT_EQ(note_count(imported, "repaired_inverse_bind"), 1u);
  EXPECT_LT((imported.asset.skeleton.positions()[1] - Eigen::Vector3d(0, 0, 1)).norm(), 1e-12);
  numbers[0] = NAN;
  file.json["skins"][0]["inverseBindMatrices"] = file.floats(numbers, "MAT4");
  test::expect_refused(file, "/skins/0/inverseBindMatrices", "none of the inverse bind matrices");
}

TEST(GltfImportSkeleton, AHiddenRootStillHasABindPose) {
  GltfBuilder file = flag();
  file.json["nodes"][1]["scale"] = {0, 0, 0};
  const Asset asset = import_built(file).asset;
  EXPECT_GT(bounding_box(asset.mesh.vertices).diagonal(), 1.0);
  EXPECT_EQ(asset.skeleton.rest[0].scale, Eigen::Vector3d(0, 0, 0));
}

TEST(GltfImportSkeleton, MakesNamesUniqueAndOrdersParentsFirst) {
  GltfBuilder file = flag();
  file.json["nodes"][1] = {{"name", "twin"}};
  file.json["nodes"][2] = {{"name", "twin"}, {"children", {1, 3}}};
  file.json["nodes"].push_back({{"translation", {0, 0, 1}}});
  file.json["skins"][0]["joints"] = {1, 2, 3};
  file.json["skins"][0].erase("inverseBindMatrices");
  file.json["scenes"][0]["nodes"] = {0, 2};
  const Skeleton skeleton = import_built(file).asset.skeleton;
  EXPECT_EQ(skeleton.names, (std::vector<std::string>{"twin", "twin_2", "joint_2"}));
  EXPECT_EQ(skeleton.parents, (std::vector<int>{-1, 0, 0}));
}

TEST(GltfImportSkeleton, ReadsNodeMatrices) {
  GltfBuilder file = flag();
  file.json["nodes"][1]["matrix"] = {0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 1, 2, 3, 1};
  const Skeleton skeleton = import_built(file).asset.skeleton;
  expect_matrix(y_up(skeleton, skeleton.rest)[0], trs({1, 2, 3}, Eigen::Quaterniond(kHalf, 0, 0, kHalf), {2, 2, 2}));
}

TEST(GltfImportSkeleton, RepairsKeyframes) {
  GltfBuilder file = flag();
  file.animate(2, "translation", {0, 1, 1, 0.5f, 2, NAN}, {0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0, NAN, 0, 0, 5, 0, 0});
  file.animate(2, "rotation", {-1, 0, 1}, {0, 0, 0, 1, 0, 0, 0, 0, 0, 3, 0, 4});
  const ImportedAsset imported = import_built(file);
  EXPECT_EQ(note_count(imported, "repaired_keyframes"), 6u);
  const std::vector<Channel>& channels = imported.asset.animations.at(0).channels;
  EXPECT_EQ(channels.at(0).times, (std::vector<double>{0, 1}));
  EXPECT_EQ(channels.at(1).times, (std::vector<double>{1}));
  EXPECT_DOUBLE_EQ(channels.at(1).values.at(1), 0.6);
}

TEST(GltfImportSkeleton, ReadsNormalisedIntegerRotations) {
  GltfBuilder file = flag();
  file.animate(2, "rotation", {0, 1}, {0, 0, 0, 1, 0, 0, 0, 1});
  file.json["animations"][0]["samplers"][0]["output"] = file.i16({0, 0, 0, 32767, 32767, 0, 0, 0}, "VEC4", true);
  EXPECT_DOUBLE_EQ(import_built(file).asset.animations.at(0).channels.at(0).values.at(4), 1.0);
}

TEST(GltfImportSkeleton, NeedsASkin) {
  GltfBuilder file = flag();
  file.json.erase("skins");
  file.json["nodes"][0].erase("skin");
  test::expect_refused(file, "/skins", "no skin: nothing to animate");
}

/// The flag without its skin, which stands two metres to the side; its node may move.
GltfBuilder bare_flag(bool moves) {
  GltfBuilder file = flag();
  file.json.erase("skins");
  file.json["nodes"][0].erase("skin");
  file.json["nodes"][0]["translation"] = {2, 0, 0};
  if (moves) file.animate(0, "translation", {0, 1.5f}, {2, 0, 0, 3, 0, 0});
  return file;
}

ImportedAsset import_without_rig(const GltfBuilder& file) {
  const test::TemporaryFolder folder;
  file.save(folder / "a.glb");
  ImportOptions options;
  options.require_rig = false;
  return read_gltf(folder / "a.glb", options);
}

TEST(GltfImportSkeleton, AMeshWithoutASkinStandsWhereItsSceneShowsIt) {
  const ImportedAsset imported = import_without_rig(bare_flag(true));
  EXPECT_EQ(imported.asset.skeleton.size(), 0u);
  EXPECT_EQ(imported.asset.skin.rows(), 0u);
  ASSERT_EQ(imported.asset.mesh.vertices.size(), 4u);
  EXPECT_EQ(imported.asset.mesh.vertices[3], Eigen::Vector3f(3, 0, 2)) << "(1, 2, 0) moved to (3, 2, 0), Z up";
  EXPECT_TRUE(imported.asset.animations.empty());
  ASSERT_EQ(imported.node_clips.size(), 1u);
  EXPECT_EQ(imported.node_clips[0].name, "move");
  EXPECT_EQ(imported.node_clips[0].seconds, 1.5);
  EXPECT_EQ(imported.node_clips[0].tracks, 1u);
  EXPECT_TRUE(import_without_rig(bare_flag(false)).node_clips.empty());
}

TEST(GltfImportSkeleton, ASkinWithoutAMeshIsASkeleton) {
  GltfBuilder file = flag();
  file.json.erase("meshes");
  file.json["nodes"][0].erase("mesh");
  file.json["nodes"][0].erase("skin");
  const ImportedAsset imported = import_without_rig(file);
  EXPECT_EQ(imported.asset.skeleton.names, (std::vector<std::string>{"hip", "knee"}));
  EXPECT_TRUE(imported.asset.mesh.vertices.empty());
  test::expect_refused(file, "/meshes", "no triangles");
}

TEST(GltfImportSkeleton, MovingNodesWithoutAMeshAreASkeleton) {
  GltfBuilder file = bare_flag(false);
  file.json.erase("meshes");
  file.json["nodes"][0].erase("mesh");
  file.animate(1, "rotation", {0, 1}, {0, 0, 0, 1, 0, 0, 1, 0});
  const ImportedAsset imported = import_without_rig(file);
  EXPECT_EQ(imported.asset.skeleton.names, (std::vector<std::string>{"hip", "knee"})) << "the knee hangs on the hip";
  ASSERT_EQ(imported.asset.animations.size(), 1u);
  EXPECT_EQ(imported.asset.animations[0].duration(), 1.0);
}

TEST(GltfImportSkeleton, ASceneOfNothingIsRefused) {
  GltfBuilder file = bare_flag(false);
  file.json["meshes"][0]["primitives"][0]["mode"] = 1;  // lines
  try {
    import_without_rig(file);
    FAIL() << "was read";
  } catch (const InputError& error) {
    EXPECT_EQ(error.problem(),
              "the scene shows nothing but points and lines, no triangles, no skin and no animation: nothing to read");
  }
}

}  // namespace
}  // namespace anigen::io
