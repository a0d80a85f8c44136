// Written files, read back by the FBX reader.
#include "anigen/io/fbx/export.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/rigs/read_assimp.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "tests/io/fbx/rig_difference.h"
#include "tests/io/small_asset.h"
#include "tests/support/paths.h"

namespace anigen::io {
namespace {

using test::rig_difference;
using test::RigDifference;
using test::small_asset;

Asset written_and_read(const Asset& asset, ExportOptions options = {}) {
  const test::TemporaryFolder folder;
  write_fbx(folder / "asset.fbx", asset, options);
  ImportOptions import;
  import.require_rig = options.require_rig;
  return read_assimp(folder / "asset.fbx", import).asset;
}

// Assimp keeps single precision: 1e-5 of the size for places, 1e-6 for other numbers, where nothing accumulates.
void expect_equal(const RigDifference& difference) {
  EXPECT_EQ(difference.broken, std::vector<std::string>());
  EXPECT_LT(difference.vertices, 1e-5);
  EXPECT_LT(difference.normals, 1e-4);  // Assimp stores them after transforming them
  EXPECT_LT(difference.uvs, 1e-6);
  EXPECT_LT(difference.colors, 1e-5);
  EXPECT_LT(difference.weights, 1e-5);
  EXPECT_LT(difference.bind_positions, 1e-5);
  EXPECT_LT(difference.clip_seconds, 1e-5);
  EXPECT_LT(difference.moving_joints, 1e-4);
}

TEST(FbxExport, ARigComesBackAsItWas) {
  for (const std::size_t joints : {std::size_t{2}, std::size_t{3}, std::size_t{8}}) {
    const Asset asset = small_asset(joints, 8, 2);
    expect_equal(rig_difference(asset, written_and_read(asset)));
  }
}

TEST(FbxExport, ARigWithoutClipsComesBackAsItWas) {
  Asset asset = small_asset();
  asset.animations.clear();
  expect_equal(rig_difference(asset, written_and_read(asset)));
  ExportOptions options;
  options.animations = false;
  EXPECT_TRUE(written_and_read(small_asset(), options).animations.empty());
}

TEST(FbxExport, SeveralClipsKeepNamesLengthsAndMotion) {
  Asset asset = small_asset();
  Animation second = asset.animations[0];
  second.name = "bow";
  for (Channel& channel : second.channels) {
    for (double& time : channel.times) time = 0.4 + 2.0 * time;
  }
  asset.animations.push_back(second);
  expect_equal(rig_difference(asset, written_and_read(asset)));
}

TEST(FbxExport, TurnsPastTheHalfComeBack) {
  Asset asset = small_asset();
  Channel& turn = asset.animations[0].channels[0];
  turn.times.clear();
  turn.values.clear();
  for (int i = 0; i <= 40; ++i) {
    const Eigen::Quaterniond q(Eigen::AngleAxisd(0.5 * i, Eigen::Vector3d(0.3, 1.0, 0.2).normalized()));
    turn.times.push_back(i / 30.0);
    turn.values.insert(turn.values.end(), {q.x(), q.y(), q.z(), q.w()});
  }
  expect_equal(rig_difference(asset, written_and_read(asset)));
}

TEST(FbxExport, NamesOfAnyScriptStay) {
  Asset asset = small_asset();
  asset.name = "狐 Füchsin";
  asset.skeleton.names = {"根", "hüfte.L", "tête 🦊"};
  asset.animations[0].name = "бег";
  const Asset back = written_and_read(asset);
  expect_equal(rig_difference(asset, back));
  EXPECT_EQ(back.animations[0].name, "бег");
}

TEST(FbxExport, NodesWithTheNameOfAJointGetAnother) {
  Asset asset = small_asset();
  asset.name = "joint_1";
  asset.skeleton.names[2] = "joint_1_2";
  expect_equal(rig_difference(asset, written_and_read(asset)));
}

TEST(FbxExport, AForestComesBackAsTheTreeThatItWasJoinedTo) {
  const Asset strip = small_asset();
  RiggedShape shape("forest", "forest.npz");
  shape.mesh = strip.mesh;
  shape.joints.positions = {{0, 0, -0.5}, {0, 0, 0}, {0.2, 0, -0.5}, {0.2, 0, 0.1}};
  shape.joints.parents = {-1, 0, -1, 2};
  for (std::size_t v = 0; v < shape.mesh.vertices.size(); ++v) shape.skin.append_row({{static_cast<int>(v % 4), 1.0f}});
  shape.materials = strip.materials;
  shape.images = strip.images;
  const Asset asset = to_asset(shape);
  expect_equal(rig_difference(asset, written_and_read(asset)));
}

TEST(FbxExport, JointsWithoutWeightsStayJoints) {
  Asset asset = small_asset(6, 8, 1);
  for (Influence& influence : asset.skin.influences) influence.joint = 3;
  expect_equal(rig_difference(asset, written_and_read(asset)));
}

TEST(FbxExport, ScaledJointsStandWhereTheyStood) {
  Asset asset = small_asset();
  asset.animations.clear();
  asset.skeleton.rest[0].scale = Eigen::Vector3d::Constant(0.01);
  for (std::size_t j = 1; j < asset.skeleton.size(); ++j) asset.skeleton.rest[j].translation *= 100.0;
  asset.skeleton.bind = forward_kinematics(asset.skeleton.parents, asset.skeleton.rest);
  const Asset back = written_and_read(asset);
  expect_equal(rig_difference(asset, back));
  EXPECT_NEAR(back.skeleton.rest[0].scale.x(), 1.0, 1e-6);  // Blender would drop it
}

TEST(FbxExport, KeepsAsManyInfluencesAsAskedFor) {
  const Asset asset = small_asset(8, 12, 7);
  ExportOptions options;
  options.influences = 7;
  expect_equal(rig_difference(asset, written_and_read(asset, options), 7));
  const Asset fewer = written_and_read(asset);
  EXPECT_EQ(fewer.skin.largest_row(), 4u);
  expect_equal(rig_difference(asset, fewer, 4));
}

TEST(FbxExport, MaterialsKeepColourTextureAndFaces) {
  const Asset asset = small_asset();
  const Asset back = written_and_read(asset);
  ASSERT_EQ(back.materials.size(), 2u);
  EXPECT_EQ(back.materials[0].name, "skin");
  EXPECT_LT((back.materials[0].base_color - asset.materials[0].base_color).norm(), 1e-6f);
  ASSERT_GE(back.materials[1].image, 0);
  EXPECT_EQ(back.images[static_cast<std::size_t>(back.materials[1].image)].bytes, asset.images[0].bytes);
  EXPECT_EQ(back.materials[0].image, -1);
  Asset glass = asset;
  glass.materials[0].base_color.w() = 0.25f;
  EXPECT_NEAR(written_and_read(glass).materials[0].base_color.w(), 0.25f, 1e-6f);
}

TEST(FbxExport, PublishedAxesTurnTheAssetAboutTheVertical) {
  Asset asset = small_asset();
  ExportOptions options;
  options.axes = ExportAxes::kPublished;
  const Asset back = written_and_read(asset, options);
  const Eigen::Vector3d place = asset.skeleton.positions()[0], turned = back.skeleton.positions()[0];
  EXPECT_LT((turned - Eigen::Vector3d(-place.x(), -place.y(), place.z())).norm(), 1e-5);
}

TEST(FbxExport, AMeshWithoutARigIsWrittenWhenAllowed) {
  Asset asset = small_asset();
  asset.skeleton = {};
  asset.skin = {};
  asset.animations.clear();
  ExportOptions options;
  options.require_rig = false;
  expect_equal(rig_difference(asset, written_and_read(asset, options)));
  const test::TemporaryFolder folder;
  EXPECT_THROW(write_fbx(folder / "a.fbx", asset), InputError);
  Asset bones = small_asset();
  bones.mesh = {};
  bones.skin = {};
  EXPECT_NO_THROW(write_fbx(folder / "bones.fbx", bones, options));
}

TEST(FbxExport, GivesTheSameBytesForTheSameAsset) {
  const test::TemporaryFolder folder;
  write_fbx(folder / "a.fbx", small_asset());
  write_fbx(folder / "b.fbx", small_asset());
  EXPECT_EQ(read_file(folder / "a.fbx"), read_file(folder / "b.fbx"));
}

TEST(FbxExport, RefusesWhatItCannotWriteAndLeavesNoFile) {
  const test::TemporaryFolder folder;
  Asset unsound = small_asset();
  unsound.mesh.faces[0][0] = 1'000'000;
  EXPECT_THROW(write_fbx(folder / "a.fbx", unsound), InputError);
  Asset zero = small_asset();
  zero.skeleton.names[1] = std::string("a\0b", 3);
  EXPECT_THROW(write_fbx(folder / "a.fbx", zero), NotSupportedError);
  Asset picture = small_asset();
  picture.images[0].bytes = {1, 2, 3};
  EXPECT_THROW(write_fbx(folder / "a.fbx", picture), InputError);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  std::filesystem::create_directory(folder / "taken.fbx");
  EXPECT_THROW(write_fbx(folder / "taken.fbx", small_asset()), Error);
  EXPECT_TRUE(std::filesystem::is_empty(folder / "taken.fbx"));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
}

}  // namespace
}  // namespace anigen::io
