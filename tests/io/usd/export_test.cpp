// Written scenes, taken apart by a parser of their own.
#include "anigen/io/usd/export.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/io/file_asset.h"
#include "anigen/io/gltf/export.h"
#include "tests/io/small_asset.h"
#include "tests/io/usd/usda_reader.h"
#include "tests/support/paths.h"

namespace anigen::io {
namespace {

using test::parse_usda;
using test::small_asset;
using test::UsdaPrim;
using test::UsdaValue;

UsdaPrim written_stage(const Asset& asset, const ExportOptions& options = {}) {
  const test::TemporaryFolder folder;
  write_usd(folder / "asset.usda", asset, options);
  return parse_usda(read_file(folder / "asset.usda"));
}

const UsdaPrim& root_of(const UsdaPrim& stage) { return stage.children.at(0); }

/// Row by row in the file, columns here: transposed.
std::vector<Eigen::Matrix4d> matrices(const UsdaValue& value) {
  std::vector<Eigen::Matrix4d> result;
  for (const UsdaValue& item : value.items)
    result.emplace_back(Eigen::Map<const Eigen::Matrix4d>(item.numbers().data()));
  return result;
}

/// Our Z up from the file's Y up.
Eigen::Vector3d place_in_world(const Eigen::Matrix4d& file) {
  return axis_rotation(ExportAxes::kGltf).transpose() * file.topRightCorner<3, 1>();
}

/// World matrices of the joints at a time of a clip, in the file's axes.
std::vector<Eigen::Matrix4d> pose_of(const UsdaPrim& skeleton, const UsdaPrim& clip, const std::vector<int>& parents,
                                     double code) {
  const auto at_code = [code](const UsdaValue& value) {
    if (value.samples.empty()) return value;
    const auto found = value.samples.find(code);
    return found == value.samples.end() ? UsdaValue() : found->second;
  };
  std::vector<Eigen::Matrix4d> local = matrices(skeleton["restTransforms"]);
  const std::vector<std::string> all = skeleton["joints"].texts(), moved = clip["joints"].texts();
  const UsdaValue translations = at_code(clip["translations"]), rotations = at_code(clip["rotations"]),
                  scales = at_code(clip["scales"]);
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const auto j = static_cast<std::size_t>(std::find(all.begin(), all.end(), moved[i]) - all.begin());
    const std::vector<double> t = translations.items.at(i).numbers(), q = rotations.items.at(i).numbers(),
                              s = scales.items.at(i).numbers();
    Transform transform;
    transform.translation = {t.at(0), t.at(1), t.at(2)};
    transform.rotation = Eigen::Quaterniond(q.at(0), q.at(1), q.at(2), q.at(3));
    transform.scale = {s.at(0), s.at(1), s.at(2)};
    local.at(j) = transform.matrix();
  }
  for (std::size_t j = 0; j < local.size(); ++j) {
    if (parents[j] >= 0) local[j] = Eigen::Matrix4d(local[static_cast<std::size_t>(parents[j])] * local[j]);
  }
  return local;
}

TEST(UsdExport, TheStageSaysItsFrame) {
  const UsdaPrim stage = written_stage(small_asset());
  ASSERT_EQ(stage.children.size(), 1u);
  EXPECT_EQ(root_of(stage).type, "SkelRoot");
  EXPECT_EQ(stage.metadata.at("defaultPrim").text, root_of(stage).name);
  EXPECT_EQ(stage.metadata.at("upAxis").text, "Y");
  EXPECT_EQ(stage.metadata.at("metersPerUnit").number(), 1.0);
  EXPECT_EQ(stage.metadata.at("timeCodesPerSecond").number(), 24.0);  // keys lie at quarters of a second
  EXPECT_EQ(stage.metadata.at("endTimeCode").number(), 24.0);
}

TEST(UsdExport, TheMeshHasAsManyOfEverythingAsItShould) {
  const Asset asset = small_asset(3, 6, 2);
  const UsdaPrim stage = written_stage(asset);
  const UsdaPrim& mesh = root_of(stage).child("Mesh");
  const std::size_t vertices = asset.mesh.vertices.size(), faces = asset.mesh.faces.size();
  const std::vector<double> points = mesh["points"].numbers();
  ASSERT_EQ(points.size(), 3 * vertices);
  for (std::size_t v = 0; v < vertices; ++v) {
    const Eigen::Vector3f& p = asset.mesh.vertices[v];
    EXPECT_EQ(static_cast<float>(points[3 * v]), p.x());
    EXPECT_EQ(static_cast<float>(points[3 * v + 1]), p.z());
    EXPECT_EQ(static_cast<float>(points[3 * v + 2]), -p.y());
  }
  EXPECT_EQ(mesh["faceVertexCounts"].numbers(), std::vector<double>(faces, 3.0));
  EXPECT_EQ(mesh["faceVertexIndices"].items.size(), 3 * faces);
  EXPECT_EQ(mesh["normals"].items.size(), vertices);
  EXPECT_EQ(mesh["primvars:displayColor"].items.size(), vertices);
  EXPECT_EQ(mesh["primvars:st"].items.size(), vertices);
  EXPECT_NEAR(mesh["primvars:st"].items[0].items[1].number(), 1.0 - asset.mesh.uvs[0].y(), 1e-6);
  EXPECT_EQ(mesh.details.at("primvars:st").at("interpolation").text, "vertex");
  const double width = mesh.details.at("primvars:skel:jointWeights").at("elementSize").number();
  EXPECT_EQ(width, 2.0);
  const std::vector<double> weights = mesh["primvars:skel:jointWeights"].numbers();
  const std::vector<double> joints = mesh["primvars:skel:jointIndices"].numbers();
  ASSERT_EQ(weights.size(), 2 * vertices);
  ASSERT_EQ(joints.size(), weights.size());
  for (std::size_t v = 0; v < vertices; ++v) {
    EXPECT_NEAR(weights[2 * v] + weights[2 * v + 1], 1.0, 1e-6);
    EXPECT_EQ(joints[2 * v], asset.skin.row(v)[0].joint);
  }
  EXPECT_EQ(mesh["skel:skeleton"].text, "/strip/Skeleton");
}

TEST(UsdExport, JointsComeAfterTheirParentsAndStandWhereTheyStood) {
  const Asset asset = small_asset(5, 6, 2);
  const UsdaPrim stage = written_stage(asset);
  const UsdaPrim& skeleton = root_of(stage).child("Skeleton");
  const std::vector<std::string> paths = skeleton["joints"].texts();
  ASSERT_EQ(paths.size(), 5u);
  for (std::size_t j = 1; j < paths.size(); ++j)
    EXPECT_EQ(paths[j].substr(0, paths[j].rfind('/')), paths[static_cast<std::size_t>(asset.skeleton.parents[j])]);
  EXPECT_EQ(skeleton["jointNames"].texts(), asset.skeleton.names);
  const std::vector<Eigen::Matrix4d> bind = matrices(skeleton["bindTransforms"]);
  const std::vector<Eigen::Matrix4d> rest = matrices(skeleton["restTransforms"]);
  ASSERT_EQ(bind.size(), 5u);
  ASSERT_EQ(rest.size(), 5u);
  const auto at_rest = forward_kinematics(asset.skeleton.parents, asset.skeleton.rest);
  Eigen::Matrix4d world = Eigen::Matrix4d::Identity();
  for (std::size_t j = 0; j < bind.size(); ++j) {
    EXPECT_LT((place_in_world(bind[j]) - asset.skeleton.positions()[j]).norm(), 1e-6);
    world = Eigen::Matrix4d(world * rest[j]);  // a chain
    EXPECT_LT((place_in_world(world) - at_rest[j].topRightCorner<3, 1>()).norm(), 1e-6);
  }
}

TEST(UsdExport, ClipsMoveTheJoints) {
  const Asset asset = small_asset(4, 6, 2);
  const UsdaPrim stage = written_stage(asset);
  const UsdaPrim &root = root_of(stage), &skeleton = root.child("Skeleton"), &clip = root.child("wave");
  EXPECT_EQ(clip.type, "SkelAnimation");
  EXPECT_EQ(skeleton["skel:animationSource"].text, "/strip/wave");
  for (const char* const name : {"translations", "rotations", "scales"}) {
    for (const auto& [code, pose] : clip[name].samples) EXPECT_EQ(pose.items.size(), clip["joints"].items.size());
  }
  // The keys that all three have.
  for (const double code : {0.0, 24.0}) {
    const UsdaPrim* at = &clip;
    UsdaPrim held = clip;
    for (const char* const name : {"translations", "rotations", "scales"}) {
      auto& samples = held.attributes[name].samples;
      if (samples.empty()) continue;
      auto found = samples.upper_bound(code);  // the value that holds
      if (found != samples.begin()) --found;
      samples = {{code, found->second}};
      at = &held;
    }
    const auto found = pose_of(skeleton, *at, asset.skeleton.parents, code);
    const auto wanted =
        forward_kinematics(asset.skeleton.parents, sample(asset.animations[0], asset.skeleton, code / 24.0));
    for (std::size_t j = 0; j < found.size(); ++j)
      EXPECT_LT((place_in_world(found[j]) - wanted[j].topRightCorner<3, 1>()).norm(), 1e-4) << code << " joint " << j;
  }
}

TEST(UsdExport, MaterialsShowColoursAndTextures) {
  const Asset asset = small_asset();
  const UsdaPrim stage = written_stage(asset);
  const UsdaPrim& root = root_of(stage);
  const UsdaPrim &skin = root.child("Materials").child("skin"), &cloth = root.child("Materials").child("cloth");
  EXPECT_EQ(skin.child("Surface")["inputs:diffuseColor.connect"].text, "/strip/Materials/skin/Colors.outputs:result");
  EXPECT_EQ(cloth.child("Picture")["inputs:file"].text, "./asset_textures/paint.png");
  EXPECT_EQ(cloth.child("Surface")["inputs:diffuseColor.connect"].text, "/strip/Materials/cloth/Picture.outputs:rgb");
  const UsdaPrim& mesh = root.child("Mesh");
  EXPECT_EQ(mesh.child("skin")["indices"].numbers(), (std::vector<double>{0, 1}));
  EXPECT_EQ(mesh.child("cloth")["material:binding"].text, "/strip/Materials/cloth");
  const double red = mesh["primvars:displayColor"].items[0].items[0].number();
  EXPECT_NEAR(red, asset.mesh.colors[0].x() * 0.8f, 1e-6);
  Asset plain = asset;
  plain.mesh.colors.clear();
  plain.mesh.face_materials.assign(plain.mesh.faces.size(), 0);
  const UsdaPrim other = written_stage(plain);
  EXPECT_NEAR(root_of(other).child("Materials").child("skin").child("Surface")["inputs:diffuseColor"].numbers()[1], 0.6,
              1e-6);
  EXPECT_EQ(root_of(other).child("Mesh")["material:binding"].text, "/strip/Materials/skin");
}

TEST(UsdExport, NamesBecomeIdentifiersAndStayBeside) {
  Asset asset = small_asset();
  asset.name = "7 \"Füchse\"";
  asset.skeleton.names = {"根", "arm.L", "arm L"};
  asset.materials[0].name = asset.materials[1].name = "";
  asset.animations[0].name = "Skeleton";
  const UsdaPrim stage = written_stage(asset);
  const UsdaPrim& root = root_of(stage);
  EXPECT_EQ(root.name, "_7__F_chse_");
  EXPECT_EQ(root.metadata.at("customData").items[0].text, asset.name);
  EXPECT_EQ(root.child("Skeleton")["joints"].texts(),
            (std::vector<std::string>{"joint", "joint/arm_L", "joint/arm_L/arm_L_2"}));
  EXPECT_EQ(root.child("Skeleton")["jointNames"].texts(), asset.skeleton.names);
  EXPECT_EQ(root.child("Skeleton")["skel:animationSource"].text, "/_7__F_chse_/Skeleton_2");
  EXPECT_EQ(root.child("Materials").children.size(), 2u);
}

TEST(UsdExport, ConstantScalesGoAndNothingMoves) {
  Asset asset = small_asset(5, 8, 2);
  asset.animations[0].channels.erase(asset.animations[0].channels.begin() + 1);  // the growing joint
  for (const std::size_t j : {std::size_t{0}, std::size_t{2}})
    asset.skeleton.rest[j].scale = Eigen::Vector3d::Constant(0.013);
  for (const std::size_t j : {std::size_t{1}, std::size_t{3}})
    asset.skeleton.rest[j].scale = Eigen::Vector3d::Constant(70.0);
  Asset without = asset;
  remove_constant_scales(without);
  for (std::size_t j = 0; j < 4; ++j) EXPECT_EQ(without.skeleton.rest[j].scale, Eigen::Vector3d(1, 1, 1));
  EXPECT_EQ(without.skeleton.rest[4].scale, asset.skeleton.rest[4].scale);  // uneven: stays
  for (const double time : {0.0, 0.3, 1.0}) {
    const auto was = skin_vertices(asset, sample(asset.animations[0], asset.skeleton, time));
    const auto is = skin_vertices(without, sample(without.animations[0], without.skeleton, time));
    for (std::size_t v = 0; v < was.size(); ++v) EXPECT_LT((was[v] - is[v]).norm(), 1e-5f);
  }
}

TEST(UsdExport, APackageHoldsTheSceneAndItsTextures) {
  const test::TemporaryFolder folder;
  const Asset asset = small_asset();
  write_usd(folder / "asset.usdz", asset);
  write_usd(folder / "again.usda", asset);
  const std::string package = read_file(folder / "asset.usdz");
  EXPECT_EQ(package.substr(30, 10), "asset.usda");
  EXPECT_NE(package.find("textures/paint.png"), std::string::npos);
  EXPECT_EQ(read_file(folder / "again_textures/paint.png"),
            std::string(asset.images[0].bytes.begin(), asset.images[0].bytes.end()));
  write_usd(folder / "other/asset.usdz", asset);
  EXPECT_EQ(read_file(folder / "other/asset.usdz"), package);
}

TEST(UsdExport, AMeshWithoutARigIsWrittenWhenAllowed) {
  Asset asset = small_asset();
  asset.skeleton = {};
  asset.skin = {};
  asset.animations.clear();
  ExportOptions options;
  options.require_rig = false;
  const UsdaPrim stage = written_stage(asset, options);
  EXPECT_EQ(root_of(stage).type, "Xform");
  EXPECT_EQ(root_of(stage).child("Mesh").attributes.count("skel:skeleton"), 0u);
  Asset bones = small_asset();
  bones.mesh = {};
  bones.skin = {};
  EXPECT_EQ(root_of(written_stage(bones, options)).child("Skeleton")["joints"].items.size(), 3u);
}

TEST(UsdExport, RefusesWhatItCannotWriteAndLeavesNoFile) {
  const test::TemporaryFolder folder;
  Asset unsound = small_asset();
  unsound.mesh.faces[0][0] = 1'000'000;
  Asset picture = small_asset();
  picture.images[0].bytes = {1, 2, 3};
  for (const char* const name : {"a.usda", "a.usdz"}) {
    EXPECT_THROW(write_usd(folder / name, unsound), InputError);
    EXPECT_THROW(write_usd(folder / name, picture), InputError);
  }
  EXPECT_THROW(write_usd(folder / "a.usd", small_asset()), InputError);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace anigen::io
