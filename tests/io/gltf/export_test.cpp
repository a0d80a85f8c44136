// Output of the exporter, read back without our importer.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <set>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/gltf/export.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/io/small_asset.h"
#include "tests/support/parsed_gltf.h"
#include "tests/support/paths.h"

namespace anigen::io {
namespace {

using test::ParsedGltf;
using test::small_asset;

ParsedGltf exported(const Asset& asset, const ExportOptions& options = {}) {
  const test::TemporaryFolder folder;
  write_gltf(folder / "asset.glb", asset, options);
  return ParsedGltf(folder / "asset.glb");
}

Eigen::Matrix3d expected_rotation(ExportAxes axes) {
  Eigen::Matrix3d r;
  if (axes == ExportAxes::kGltf)
    r << 1, 0, 0, 0, 0, 1, 0, -1, 0;  // (x, y, z) → (x, z, −y)
  else
    r << -1, 0, 0, 0, 0, 1, 0, 1, 0;  // (x, y, z) → (−x, z, y)
  return r;
}

Eigen::Quaterniond quaternion(const Json& xyzw) { return {xyzw[3], xyzw[0], xyzw[1], xyzw[2]}; }

std::size_t files_in(const std::filesystem::path& folder) {
  return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(folder), {}));
}

class GltfExportAxes : public ::testing::TestWithParam<ExportAxes> {};

TEST_P(GltfExportAxes, TurnsPositionsExactlyAndGivesTheirBounds) {
  const Asset asset = small_asset();
  ExportOptions options;
  options.axes = GetParam();
  const ParsedGltf file = exported(asset, options);
  const std::vector<double> positions = file.attribute("POSITION");
  ASSERT_EQ(positions.size(), 3 * asset.mesh.vertices.size());
  Eigen::Vector3d low(1e9, 1e9, 1e9), high = -low;
  for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) {
    const Eigen::Vector3d wanted = expected_rotation(options.axes) * asset.mesh.vertices[v].cast<double>();
    const Eigen::Vector3d got(positions[3 * v], positions[3 * v + 1], positions[3 * v + 2]);
    ASSERT_EQ(got, wanted) << "vertex " << v;  // a permutation with signs rounds nothing
    low = low.cwiseMin(got);
    high = high.cwiseMax(got);
  }
  const Json& primitive = file.json["meshes"][0]["primitives"][0];
  const Json& accessor = file.json["accessors"][primitive["attributes"]["POSITION"].get<std::size_t>()];
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(accessor["min"][k].get<double>(), low[static_cast<int>(k)]);
    EXPECT_EQ(accessor["max"][k].get<double>(), high[static_cast<int>(k)]);
  }
}

TEST_P(GltfExportAxes, NodesGiveTheTurnedRestPose) {
  const Asset asset = small_asset(4);
  ExportOptions options;
  options.axes = GetParam();
  const ParsedGltf file = exported(asset, options);
  const std::vector<Eigen::Matrix4d> world = forward_kinematics(asset.skeleton.parents, asset.skeleton.rest);
  Eigen::Matrix4d up = Eigen::Matrix4d::Identity();
  up.topLeftCorner<3, 3>() = expected_rotation(options.axes);
  std::vector<Eigen::Matrix4d> in_file(4);
  for (std::size_t j = 0; j < 4; ++j) {
    const Json& node = file.json["nodes"][j];
    EXPECT_EQ(node["name"].get<std::string>(), asset.skeleton.names[j]);
    Transform local;
    for (int k = 0; k < 3; ++k) {
      local.translation[k] = node["translation"][static_cast<std::size_t>(k)];
      local.scale[k] = node["scale"][static_cast<std::size_t>(k)];
    }
    local.rotation = quaternion(node["rotation"]);
    in_file[j] = j == 0 ? local.matrix() : Eigen::Matrix4d(in_file[j - 1] * local.matrix());
    EXPECT_LT((in_file[j] - up * world[j]).cwiseAbs().maxCoeff(), 1e-14);  // JSON carries doubles
  }
}

TEST_P(GltfExportAxes, InverseBindMatricesUndoTheTurnedBindPose) {
  const Asset asset = small_asset(5);
  ExportOptions options;
  options.axes = GetParam();
  const ParsedGltf file = exported(asset, options);
  const std::vector<double> numbers = file.numbers(file.json["skins"][0]["inverseBindMatrices"].get<std::size_t>());
  ASSERT_EQ(numbers.size(), 16u * 5u);
  Eigen::Matrix4d up = Eigen::Matrix4d::Identity();
  up.topLeftCorner<3, 3>() = expected_rotation(options.axes);
  for (std::size_t j = 0; j < 5; ++j) {
    const Eigen::Map<const Eigen::Matrix4d> inverse(numbers.data() + 16 * j);
    EXPECT_EQ(inverse.row(3), Eigen::RowVector4d(0, 0, 0, 1));
    const Eigen::Matrix4d product = inverse * up * asset.skeleton.bind[j];
    EXPECT_LT((product - Eigen::Matrix4d::Identity()).cwiseAbs().maxCoeff(), 1e-6);  // single precision
  }
}

// Engines show no rotation at any joint, and the bind pose is as with any other axes of the joints.
TEST_P(GltfExportAxes, UnrotatedJointsStandInTheFileWithoutRotation) {
  const test::TemporaryFolder folder;
  Asset asset = small_asset();
  asset.animations.clear();
  ExportOptions options;
  options.axes = GetParam();
  asset.skeleton = unrotated_in_file(asset.skeleton, options.axes);
  write_gltf(folder / "asset.glb", asset, options);
  const ParsedGltf file(folder / "asset.glb");
  for (std::size_t j = 0; j < asset.skeleton.size(); ++j) {
    const Eigen::Quaterniond rotation = quaternion(file.json["nodes"][j]["rotation"]);
    EXPECT_EQ(rotation.vec(), Eigen::Vector3d::Zero()) << "joint " << j;
    EXPECT_NEAR(rotation.w(), 1.0, 1e-15) << "joint " << j;
  }
  const Asset back = read_gltf(folder / "asset.glb").asset;
  ASSERT_EQ(back.mesh.vertices.size(), asset.mesh.vertices.size());
  const std::vector<Eigen::Vector3f> rested =
      skin_vertices(back, forward_kinematics(back.skeleton.parents, back.skeleton.rest));
  for (std::size_t v = 0; v < rested.size(); ++v)
    EXPECT_LE((rested[v] - back.mesh.vertices[v]).norm(), 1e-6F) << "vertex " << v;
}

TEST_P(GltfExportAxes, RootChannelsAreTurnedWithTheirTangents) {
  const Asset asset = small_asset();
  ExportOptions options;
  options.axes = GetParam();
  const ParsedGltf file = exported(asset, options);
  const Eigen::Matrix3d up = expected_rotation(options.axes);
  const Json& animation = file.json["animations"][0];
  ASSERT_EQ(animation["channels"].size(), 3u);
  const std::vector<double> turn = file.numbers(animation["samplers"][0]["output"].get<std::size_t>());
  const Channel& turn_in = asset.animations[0].channels[0];
  ASSERT_EQ(turn.size(), turn_in.values.size());
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Quaterniond got(turn[4 * k + 3], turn[4 * k], turn[4 * k + 1], turn[4 * k + 2]);
    const double* q = turn_in.values.data() + 4 * k;
    const Eigen::Matrix3d wanted = up * Eigen::Quaterniond(q[3], q[0], q[1], q[2]).toRotationMatrix();
    EXPECT_LT((got.toRotationMatrix() - wanted).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_NEAR(got.norm(), 1.0, 1e-6);
  }
  EXPECT_EQ(animation["samplers"][1]["interpolation"], "STEP");
  const std::vector<double> grow = file.numbers(animation["samplers"][1]["output"].get<std::size_t>());
  EXPECT_EQ(grow, asset.animations[0].channels[1].values);  // a child's channel, exact in float
  EXPECT_EQ(animation["samplers"][2]["interpolation"], "CUBICSPLINE");
  const std::vector<double> move = file.numbers(animation["samplers"][2]["output"].get<std::size_t>());
  const Channel& move_in = asset.animations[0].channels[2];
  ASSERT_EQ(move.size(), move_in.values.size());
  for (std::size_t i = 0; i < move.size(); i += 3) {
    const Eigen::Vector3d wanted = up * Eigen::Map<const Eigen::Vector3d>(move_in.values.data() + i);
    EXPECT_LT((Eigen::Map<const Eigen::Vector3d>(move.data() + i) - wanted).cwiseAbs().maxCoeff(), 1e-7);
  }
}

INSTANTIATE_TEST_SUITE_P(Both, GltfExportAxes, ::testing::Values(ExportAxes::kGltf, ExportAxes::kPublished),
                         [](const auto& info) {
                           return std::string(info.param == ExportAxes::kGltf ? "gltf" : "published");
                         });

TEST(GltfExport, SceneHoldsTheRootAndTheMeshBesideIt) {
  const ParsedGltf file = exported(small_asset(4));
  EXPECT_EQ(file.json["asset"]["generator"], "AniGen in C++");
  EXPECT_EQ(file.json["scenes"][0]["nodes"], Json::parse("[0, 4]"));
  EXPECT_EQ(file.json["nodes"][4]["mesh"], 0);
  EXPECT_EQ(file.json["nodes"][4]["skin"], 0);
  EXPECT_FALSE(file.json["nodes"][4].contains("children"));
  EXPECT_EQ(file.json["skins"][0]["joints"], Json::parse("[0, 1, 2, 3]"));
  EXPECT_EQ(file.json["skins"][0]["skeleton"], 0);
  EXPECT_EQ(file.json["nodes"][1]["children"], Json::parse("[2]"));
}

TEST(GltfExport, MeshNodeNeverSharesAJointsName) {
  Asset asset = small_asset(2);
  asset.name = asset.skeleton.names[1];
  const ParsedGltf file = exported(asset);
  std::set<std::string> names;
  for (const Json& node : file.json["nodes"]) EXPECT_TRUE(names.insert(node["name"]).second) << node["name"];
}

TEST(GltfExport, WeightsSumToOneAndKeepTheHeaviest) {
  Asset asset = small_asset(9, 30, 9);
  for (const std::size_t influences : {1u, 3u, 4u, 6u, 9u, 50u}) {
    ExportOptions options;
    options.influences = influences;
    const ParsedGltf file = exported(asset, options);
    const std::size_t kept = std::min<std::size_t>(influences, 9), sets = (kept + 3) / 4;
    const Json& attributes = file.json["meshes"][0]["primitives"][0]["attributes"];
    EXPECT_TRUE(attributes.contains("JOINTS_" + std::to_string(sets - 1)));
    EXPECT_FALSE(attributes.contains("JOINTS_" + std::to_string(sets)));
    EXPECT_FALSE(attributes.contains("WEIGHTS_" + std::to_string(sets)));
    const SkinWeights wanted = limit_influences(asset.skin, kept);
    for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) {
      std::map<int, double> row;
      double sum = 0.0;
      for (std::size_t s = 0; s < sets; ++s) {
        const std::vector<double> joints = file.attribute("JOINTS_" + std::to_string(s));
        const std::vector<double> weights = file.attribute("WEIGHTS_" + std::to_string(s));
        for (std::size_t k = 4 * v; k < 4 * v + 4; ++k) {
          sum += weights[k];
          if (weights[k] > 0) {
            EXPECT_TRUE(row.emplace(static_cast<int>(joints[k]), weights[k]).second);
          } else {
            EXPECT_EQ(joints[k], 0) << "a slot without weight must name joint 0";
          }
        }
      }
      ASSERT_EQ(row.size(), wanted.row_size(v));
      EXPECT_NEAR(sum, 1.0, 1e-7 * static_cast<double>(kept));  // half of what Khronos' validator permits
      for (std::size_t i = 0; i < wanted.row_size(v); ++i)
        EXPECT_NEAR(row[wanted.row(v)[i].joint], wanted.row(v)[i].weight, 1e-6);
    }
  }
}

TEST(GltfExport, RowsThatMissOneByRoundingAreRepaired) {
  Asset asset = small_asset(3, 1, 3);
  for (Influence& influence : asset.skin.influences) influence.weight *= 1.000008f;  // still sound for validate()
  const ParsedGltf file = exported(asset);
  const std::vector<double> weights = file.attribute("WEIGHTS_0");
  for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v)
    EXPECT_NEAR(weights[4 * v] + weights[4 * v + 1] + weights[4 * v + 2], 1.0, 1e-7);
}

TEST(GltfExport, JointIndicesAreBytesUpTo255Joints) {
  for (const std::size_t joints : {255u, 256u, 300u}) {
    const Asset asset = small_asset(joints, 300, 2);
    const ParsedGltf file = exported(asset);
    const Json& attributes = file.json["meshes"][0]["primitives"][0]["attributes"];
    const int type = file.json["accessors"][attributes["JOINTS_0"].get<std::size_t>()]["componentType"];
    EXPECT_EQ(type, joints <= 255 ? 5121 : 5123) << joints;
    const std::vector<double> indices = file.attribute("JOINTS_0");
    for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) ASSERT_EQ(indices[4 * v], asset.skin.row(v)[0].joint);
  }
}

TEST(GltfExport, IndicesAre32BitOnlyWhereNeeded) {
  for (const std::size_t vertices : {65534u, 65536u, 65538u}) {  // 65535 is reserved in 16-bit indices
    Asset asset = small_asset(1, vertices / 2 - 1, 1);
    asset.mesh.face_materials.clear();
    const ParsedGltf file = exported(asset);
    const std::size_t accessor = file.json["meshes"][0]["primitives"][0]["indices"];
    EXPECT_EQ(file.json["accessors"][accessor]["componentType"], vertices <= 65535 ? 5123 : 5125) << vertices;
    const std::vector<double> indices = file.numbers(accessor);
    ASSERT_EQ(indices.size(), 3 * asset.mesh.faces.size());
    EXPECT_EQ(indices[indices.size() - 2], static_cast<double>(vertices - 1));
  }
}

TEST(GltfExport, OnePrimitivePerMaterialOverSharedVertices) {
  const Asset asset = small_asset();
  const ParsedGltf file = exported(asset);
  const Json& primitives = file.json["meshes"][0]["primitives"];
  ASSERT_EQ(primitives.size(), 2u);
  EXPECT_EQ(primitives[0]["attributes"], primitives[1]["attributes"]);
  std::size_t face = 0;  // the two materials follow each other in small_asset()
  for (const Json& primitive : primitives) {
    const std::vector<double> indices = file.numbers(primitive["indices"].get<std::size_t>());
    for (std::size_t i = 0; i < indices.size(); i += 3, ++face) {
      for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(indices[i + k], asset.mesh.faces[face][k]);
    }
  }
  EXPECT_EQ(face, asset.mesh.faces.size());
  const Json& skin = file.json["materials"][0];
  EXPECT_EQ(skin["name"], "skin");
  EXPECT_EQ(skin["doubleSided"], true);
  EXPECT_FLOAT_EQ(skin["pbrMetallicRoughness"]["baseColorFactor"][1].get<float>(), 0.6f);
  EXPECT_EQ(skin["pbrMetallicRoughness"]["metallicFactor"], 0.0);
  EXPECT_EQ(skin["pbrMetallicRoughness"]["roughnessFactor"], 1.0);
  EXPECT_FALSE(skin["pbrMetallicRoughness"].contains("baseColorTexture"));
  EXPECT_FALSE(file.json["materials"][1].value("doubleSided", false));
}

TEST(GltfExport, SaysWhatAlphaMeansWhereTheAssetDoes) {
  Asset asset = small_asset();
  EXPECT_FALSE(exported(asset).json["materials"][0].contains("alphaMode"));
  asset.materials[0].alpha_mode = AlphaMode::kMask;
  asset.materials[0].alpha_cutoff = 0.25f;
  asset.materials[1].alpha_mode = AlphaMode::kBlend;
  const ParsedGltf file = exported(asset);
  EXPECT_EQ(file.json["materials"][0]["alphaMode"], "MASK");
  EXPECT_EQ(file.json["materials"][0]["alphaCutoff"], 0.25);
  EXPECT_EQ(file.json["materials"][1]["alphaMode"], "BLEND");
}

TEST(GltfExport, TextureBytesAreKept) {
  const Asset asset = small_asset();
  const ParsedGltf file = exported(asset);
  EXPECT_EQ(file.json["materials"][1]["pbrMetallicRoughness"]["baseColorTexture"]["index"], 0);
  EXPECT_EQ(file.json["textures"][0]["source"], 0);
  EXPECT_EQ(file.json["images"][0]["mimeType"], "image/png");
  const std::string bytes = file.image(0);
  EXPECT_TRUE(std::equal(bytes.begin(), bytes.end(), asset.images[0].bytes.begin(), asset.images[0].bytes.end(),
                         [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; }));
}

TEST(GltfExport, WithoutMaterialsAPlainOneIsWritten) {
  Asset asset = small_asset();
  asset.materials.clear();
  asset.images.clear();
  asset.mesh.face_materials.clear();
  const ParsedGltf file = exported(asset);
  ASSERT_EQ(file.json["materials"].size(), 1u);
  EXPECT_EQ(file.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"], Json::parse("[1.0, 1.0, 1.0, 1.0]"));
  EXPECT_EQ(file.json["meshes"][0]["primitives"].size(), 1u);
  EXPECT_FALSE(file.json.contains("images"));
}

TEST(GltfExport, UnusedMaterialsAndImagesAreLeftOut) {
  Asset asset = small_asset();
  asset.mesh.face_materials.assign(asset.mesh.faces.size(), 0);
  const ParsedGltf file = exported(asset);
  EXPECT_EQ(file.json["materials"].size(), 1u);
  EXPECT_FALSE(file.json.contains("textures"));
  EXPECT_FALSE(file.json.contains("images"));
}

TEST(GltfExport, AnimationTimesIncreaseInSinglePrecision) {
  Asset asset = small_asset();
  // The middle two are one float; the merged key must hold the later value.
  Channel channel{1, ChannelPath::kTranslation, Interpolation::kLinear, {0.0, 1.0, 1.0 + 1e-12, 2.0}, {}};
  for (int k = 0; k < 4; ++k) channel.values.insert(channel.values.end(), {double(k), 0.0, 0.0});
  asset.animations[0].channels = {channel};
  const ParsedGltf file = exported(asset);
  const Json& sampler = file.json["animations"][0]["samplers"][0];
  const std::size_t input = sampler["input"];
  EXPECT_EQ(file.numbers(input), (std::vector<double>{0, 1, 2}));
  EXPECT_EQ(file.json["accessors"][input]["min"], Json::parse("[0.0]"));
  EXPECT_EQ(file.json["accessors"][input]["max"], Json::parse("[2.0]"));
  EXPECT_EQ(file.numbers(sampler["output"].get<std::size_t>()), (std::vector<double>{0, 0, 0, 2, 0, 0, 3, 0, 0}));
}

TEST(GltfExport, MergedSplineKeyTakesTheOuterTangents) {
  Asset asset = small_asset();
  Channel channel{1, ChannelPath::kScale, Interpolation::kCubicSpline, {1.0, 1.0 + 1e-12, 2.0}, {}};
  for (int i = 0; i < 27; ++i) channel.values.push_back(i + 1);
  asset.animations[0].channels = {channel};
  const ParsedGltf file = exported(asset);
  const std::vector<double> values =
      file.numbers(file.json["animations"][0]["samplers"][0]["output"].get<std::size_t>());
  ASSERT_EQ(values.size(), 18u);
  EXPECT_EQ(std::vector<double>(values.begin(), values.begin() + 9),
            (std::vector<double>{1, 2, 3, 13, 14, 15, 16, 17, 18}));
}

TEST(GltfExport, SplineOfOneKeyBecomesAConstant) {
  Asset asset = small_asset();
  asset.animations[0].channels = {
      {1, ChannelPath::kScale, Interpolation::kCubicSpline, {0.5}, {9, 9, 9, 1, 2, 3, 9, 9, 9}}};
  const ParsedGltf file = exported(asset);
  const Json& sampler = file.json["animations"][0]["samplers"][0];
  EXPECT_EQ(sampler["interpolation"], "STEP");
  EXPECT_EQ(file.numbers(sampler["output"].get<std::size_t>()), (std::vector<double>{1, 2, 3}));
}

TEST(GltfExport, OfTwoChannelsForOnePropertyTheLastIsWritten) {
  Asset asset = small_asset();
  asset.animations[0].channels = {{1, ChannelPath::kScale, Interpolation::kLinear, {0.0}, {1, 1, 1}},
                                  {1, ChannelPath::kScale, Interpolation::kLinear, {0.0}, {2, 2, 2}}};
  const ParsedGltf file = exported(asset);
  ASSERT_EQ(file.json["animations"][0]["channels"].size(), 1u);
  const std::size_t output = file.json["animations"][0]["samplers"][0]["output"];
  EXPECT_EQ(file.numbers(output), (std::vector<double>{2, 2, 2}));
}

TEST(GltfExport, EmptyAnimationsAndUnwantedOnesAreLeftOut) {
  Asset asset = small_asset();
  ExportOptions options;
  options.animations = false;
  EXPECT_FALSE(exported(asset, options).json.contains("animations"));
  asset.animations = {Animation{"nothing", {}}};
  EXPECT_FALSE(exported(asset).json.contains("animations"));
}

TEST(GltfExport, NamesThatAreNotUtf8AreRepaired) {
  Asset asset = small_asset();
  asset.skeleton.names[1] = "bone\xff\xfe";
  const std::string name = exported(asset).json["nodes"][1]["name"];
  EXPECT_EQ(name.substr(0, 4), "bone");
}

TEST(GltfExport, SameAssetGivesTheSameBytes) {
  const test::TemporaryFolder folder;
  write_gltf(folder / "a.glb", small_asset());
  write_gltf(folder / "b.glb", small_asset());
  EXPECT_EQ(read_file(folder / "a.glb"), read_file(folder / "b.glb"));
}

TEST(GltfExport, TextFileEmbedsItsBuffer) {
  const test::TemporaryFolder folder;
  write_gltf(folder / "asset.GLTF", small_asset());
  EXPECT_EQ(files_in(folder.path()), 1u);
  const Json json = read_json(folder / "asset.GLTF");
  const std::string uri = json["buffers"][0]["uri"];
  const std::string prefix = "data:application/octet-stream;base64,";
  ASSERT_EQ(uri.substr(0, prefix.size()), prefix);
  const std::size_t length = json["buffers"][0]["byteLength"];
  EXPECT_EQ(uri.size() - prefix.size(), (length + 2) / 3 * 4);
}

struct Flaw {
  const char* name;
  std::function<void(Asset&)> make;
};

class GltfExportRefuses : public ::testing::TestWithParam<Flaw> {};

TEST_P(GltfExportRefuses, AndLeavesNoFile) {
  Asset asset = small_asset();
  GetParam().make(asset);
  const test::TemporaryFolder folder;
  EXPECT_THROW(write_gltf(folder / "asset.glb", asset), InputError);
  EXPECT_EQ(files_in(folder.path()), 0u);
}

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

INSTANTIATE_TEST_SUITE_P(
    UnsoundAssets, GltfExportRefuses,
    ::testing::Values(Flaw{"no_faces", [](Asset& a) { a.mesh.faces.clear(), a.mesh.face_materials.clear(); }},
                      Flaw{"nan_vertex", [](Asset& a) { a.mesh.vertices[1].y() = kNan; }},
                      Flaw{"face_out_of_range", [](Asset& a) { a.mesh.faces[0][2] = 1000; }},
                      Flaw{"no_joints", [](Asset& a) { a.skeleton = {}; }},
                      Flaw{"rest_not_finite", [](Asset& a) { a.skeleton.rest[1].translation.x() = kNan; }},
                      Flaw{"two_roots", [](Asset& a) { a.skeleton.parents[1] = -1; }},
                      Flaw{"singular_bind", [](Asset& a) { a.skeleton.bind[2].setZero(); }},
                      Flaw{"bind_beyond_float", [](Asset& a) { a.skeleton.bind[2].topLeftCorner<3, 3>() *= 1e-60; }},
                      Flaw{"missing_weights", [](Asset& a) { a.skin = {}; }},
                      Flaw{"weights_of_unknown_joint", [](Asset& a) { a.skin.influences[0].joint = 77; }},
                      Flaw{"short_channel", [](Asset& a) { a.animations[0].channels[0].values.pop_back(); }},
                      Flaw{"zero_rotation", [](Asset& a) { a.animations[0].channels[0].values.assign(12, 0.0); }},
                      Flaw{"key_beyond_float", [](Asset& a) { a.animations[0].channels[1].values[0] = 1e300; }},
                      Flaw{"texture_of_unknown_type",
                           [](Asset& a) {
                             a.images[0].bytes = {'G', 'I', 'F', '8'};
                           }},
                      Flaw{"material_of_unknown_image", [](Asset& a) { a.materials[1].image = 5; }}),
    [](const auto& info) { return std::string(info.param.name); });

ExportOptions without_rig() {
  ExportOptions options;
  options.require_rig = false;
  return options;
}

TEST(GltfExport, AMeshWithoutARigIsWrittenWhereTheCallerAllowsIt) {
  Asset asset = small_asset();
  asset.skeleton = {};
  asset.skin = {};
  asset.animations.clear();
  EXPECT_THROW(exported(asset), InputError);
  const test::TemporaryFolder folder;
  write_gltf(folder / "asset.glb", asset, without_rig());
  const ParsedGltf file(folder / "asset.glb");
  EXPECT_FALSE(file.json.contains("skins"));
  EXPECT_EQ(file.json["scenes"][0]["nodes"], Json::array({0}));
  EXPECT_FALSE(file.json["nodes"][0].contains("skin"));
  EXPECT_FALSE(file.json["meshes"][0]["primitives"][0]["attributes"].contains("JOINTS_0"));
  ImportOptions options;
  options.require_rig = false;
  const Asset back = read_gltf(folder / "asset.glb", options).asset;
  EXPECT_EQ(back.mesh.vertices, asset.mesh.vertices);
  EXPECT_EQ(back.mesh.faces, asset.mesh.faces);
  EXPECT_EQ(back.skeleton.size(), 0u);
}

TEST(GltfExport, ASkeletonWithoutAMeshIsWrittenWithItsMotion) {
  Asset asset = small_asset();
  asset.mesh = {};
  asset.skin = {};
  asset.materials.clear();
  asset.images.clear();
  EXPECT_THROW(exported(asset), InputError);
  const test::TemporaryFolder folder;
  write_gltf(folder / "asset.glb", asset, without_rig());
  EXPECT_FALSE(ParsedGltf(folder / "asset.glb").json.contains("meshes"));
  ImportOptions options;
  options.require_rig = false;
  const Asset back = read_gltf(folder / "asset.glb", options).asset;
  EXPECT_EQ(back.skeleton.names, asset.skeleton.names);
  EXPECT_TRUE(back.mesh.vertices.empty());
  ASSERT_EQ(back.animations.size(), 1u);
  EXPECT_EQ(back.animations[0].channels.size(), asset.animations[0].channels.size());
}

TEST(GltfExport, AMeshBesideASkeletonNeedsWeights) {
  Asset asset = small_asset();
  asset.skin = {};
  try {
    exported(asset, without_rig());
    FAIL() << "was written";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("no skin weights"), std::string::npos);
  }
}

TEST(GltfExport, RefusedExportKeepsTheOldFile) {
  const test::TemporaryFolder folder;
  write_file_atomically(folder / "asset.glb", "old");
  Asset asset = small_asset();
  asset.mesh.vertices[0].x() = kNan;
  EXPECT_THROW(write_gltf(folder / "asset.glb", asset), InputError);
  EXPECT_EQ(read_file(folder / "asset.glb"), "old");
}

TEST(GltfExport, RefusesOtherExtensionsAndZeroInfluences) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(write_gltf(folder / "asset.obj", small_asset()), InputError);
  ExportOptions options;
  options.influences = 0;
  EXPECT_THROW(write_gltf(folder / "asset.glb", small_asset(), options), InputError);
  EXPECT_EQ(files_in(folder.path()), 0u);
}

}  // namespace
}  // namespace anigen::io
