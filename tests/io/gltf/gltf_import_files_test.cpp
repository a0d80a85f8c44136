#include <gtest/gtest.h>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <sstream>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/io/gltf/gltf_import_reference.h"
#include "tests/io/gltf/gltf_import_support.h"
#include "tests/io/small_asset.h"
#include "tests/support/paths.h"

// Every real rigged file: imports, agrees with the manifest, and poses as glTF's formula says.

// Import of meshes, weights, materials and scenes, on small hand-written files.

namespace anigen::io {

namespace {

namespace fs = std::filesystem;
using test::has_note;

// Skins of these files place joints they share differently; their vertices are posed into one of the bind poses.
const std::set<std::string> kConflicts = {};
// Compressed files: the reference reader cannot read them.
const std::set<std::string> kCompressed = {"neg_draco_flamingo", "neg_meshopt_triangles"};

struct ManifestRow {
  std::size_t vertices = 0, faces = 0, joints = 0, animations = 0;
};

// Columns: name, category, file, vertices, faces, joints, skins, animations, …; keyed by the file.
std::map<std::string, ManifestRow> read_manifest() {
  std::map<std::string, ManifestRow> rows;
  std::ifstream in(test::assets_dir() / "MANIFEST.csv");
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    std::vector<std::string> cells;
    std::stringstream text(line);
    for (std::string cell; cells.size() < 8 && std::getline(text, cell, ',');) cells.push_back(cell);
    if (cells.size() == 8) {
      rows[cells[2]] = {std::stoul(cells[3]), std::stoul(cells[4]), std::stoul(cells[5]), std::stoul(cells[7])};
    }
  }
  return rows;
}

std::size_t count_of(const ImportedAsset& imported, const std::string& code) {
  for (const ImportNote& note : imported.notes) {
    if (note.code == code) return std::stoul(note.message);
  }
  return 0;
}

double largest_distance(const std::vector<Eigen::Vector3f>& a, const std::vector<Eigen::Vector3f>& b) {
  double largest = 0.0;
  for (std::size_t v = 0; v < a.size(); ++v) {
    const double distance = static_cast<double>((a[v] - b[v]).norm());
    if (b[v].allFinite()) largest = std::max(largest, a[v].allFinite() ? distance : 1e300);
  }
  return largest;
}

class RiggedFile : public testing::TestWithParam<fs::path> {
 protected:
  std::string name() const { return GetParam().stem().string(); }
};

TEST_P(RiggedFile, ImportsAsTheManifestSays) {
  const ImportedAsset imported = read_gltf(GetParam());
  const Asset& asset = imported.asset;
  const std::vector<std::string> findings = validate(asset);
  EXPECT_TRUE(findings.empty()) << findings.front();
  const auto manifest = read_manifest();
  const auto row = manifest.find(fs::relative(GetParam(), test::assets_dir()).string());
  ASSERT_NE(row, manifest.end());
  EXPECT_EQ(asset.mesh.vertices.size(), row->second.vertices);
  EXPECT_EQ(asset.mesh.faces.size() + count_of(imported, "degenerate_faces"), row->second.faces);
  // The manifest counts the joints of the skins; the importer adds what it made and promoted.
  const std::size_t made = has_note(imported, "several_roots") ? 1 : 0;
  EXPECT_EQ(asset.skeleton.size(), row->second.joints + made + count_of(imported, "promoted_node"));
  EXPECT_EQ(asset.animations.size(), row->second.animations);
  EXPECT_EQ(has_note(imported, "bind_pose_conflict"), kConflicts.count(name()) != 0);
}

TEST_P(RiggedFile, BindPoseReproducesTheMesh) {
  const Asset asset = read_gltf(GetParam()).asset;
  // W · C⁻¹ is the identity up to the rounding of an inverse of a badly scaled matrix.
  EXPECT_LE(largest_distance(asset.mesh.vertices, skin_vertices(asset, asset.skeleton.bind)),
            1e-5 * bounding_box(asset.mesh.vertices).diagonal());
}

TEST_P(RiggedFile, PosesLikeTheFormula) {
  if (kCompressed.count(name()) != 0) {
    GTEST_SKIP() << "not supported: a second reader of compressed files";
  }
  const Asset asset = read_gltf(GetParam()).asset;
  const test::GltfReference reference(GetParam());
  const std::vector<Eigen::Vector3f> expected = reference.vertices();
  ASSERT_EQ(expected.size(), asset.mesh.vertices.size());
  EXPECT_EQ(asset.mesh.faces.size(), reference.triangles());
  if (kConflicts.count(name()) != 0) return;
  EXPECT_LE(largest_distance(skin_vertices(asset, asset.skeleton.rest), expected),
            1e-4 * bounding_box(expected).diagonal());
}

TEST_P(RiggedFile, MovesLikeTheFormula) {
  const Asset asset = read_gltf(GetParam()).asset;
  const std::size_t shown = std::min<std::size_t>(asset.animations.size(), 3);
  const bool comparable = kCompressed.count(name()) == 0 && kConflicts.count(name()) == 0;
  const auto reference = comparable ? std::make_unique<test::GltfReference>(GetParam()) : nullptr;
  const std::vector<bool> loose = reference ? reference->follows_no_joint() : std::vector<bool>();
  for (std::size_t a = 0; a < shown; ++a) {
    const double duration = asset.animations[a].duration();
    for (const double part : {0.0, 0.37, 0.81, 1.0}) {
      const Pose pose = sample(asset.animations[a], asset.skeleton, part * duration);
      const std::vector<Eigen::Vector3f> moved = skin_vertices(asset, pose);
      for (const Eigen::Vector3f& v : moved) ASSERT_TRUE(v.allFinite()) << asset.animations[a].name;
      if (!reference) continue;
      std::vector<Eigen::Vector3f> expected = reference->vertices(static_cast<int>(a), part * duration);
      // The importer binds these to the root, so that the asset is one piece.
      for (std::size_t v = 0; v < expected.size(); ++v) {
        if (loose[v]) expected[v] = moved[v];
      }
      EXPECT_LE(largest_distance(moved, expected), 1e-4 * bounding_box(expected).diagonal())
          << asset.animations[a].name << " at " << part;
    }
  }
}

std::string test_name(const testing::TestParamInfo<fs::path>& info) {
  std::string name = info.param.stem().string();
  std::replace_if(
      name.begin(), name.end(), [](char c) { return std::isalnum(static_cast<unsigned char>(c)) == 0; }, '_');
  return name;
}

GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(RiggedFile);
INSTANTIATE_TEST_SUITE_P(Assets, RiggedFile, testing::ValuesIn(test::rigged_files()), test_name);

TEST(RiggedFiles, AreThere) {
  if (!fs::exists(test::assets_dir() / "rigged")) {
    GTEST_SKIP() << test::assets_dir() << " is not there";
  }
  EXPECT_GE(test::rigged_files().size(), 40u);
}

TEST(RiggedFiles, RepairsAreReportedWithTheirCounts) {
  const fs::path rigged = test::assets_dir() / "rigged";
  if (!fs::exists(rigged)) {
    GTEST_SKIP() << test::assets_dir() << " is not there";
  }
  EXPECT_EQ(count_of(read_gltf(rigged / "arthropod/q_crab_nan.glb"), "nan_weights"), 6u);
  EXPECT_EQ(count_of(read_gltf(rigged / "plant/dcl_tree/Tree.gltf"), "zero_weights"), 44u);
  EXPECT_GT(count_of(read_gltf(rigged / "synthetic/godot_unnormalised.glb"), "unnormalised_weights"), 0u);
  EXPECT_EQ(count_of(read_gltf(rigged / "negative/neg_draco_flamingo.glb"), "decoded_draco"), 2u);
  EXPECT_TRUE(has_note(read_gltf(rigged / "negative/neg_meshopt_triangles.glb"), "decoded_meshopt"));
  EXPECT_TRUE(has_note(read_gltf(rigged / "synthetic/ag_skin_no_ibm/Animation_Skin_04.gltf"), "missing_inverse_bind"));
  EXPECT_EQ(count_of(read_gltf(rigged / "quadruped/q_stag.glb"), "rigid_mesh_on_joint"), 1u);
  EXPECT_EQ(count_of(read_gltf(rigged / "machine/q_tank.glb"), "unskinned_mesh"), 2u);
  EXPECT_TRUE(has_note(read_gltf(rigged / "humanoid/greenman.glb"), "several_roots"));
}

}  // namespace

namespace {

using test::flag;
using test::GltfBuilder;
using test::has_note;
using test::import_built;
using test::note_count;

Json& primitive(GltfBuilder& file) { return file.json["meshes"][0]["primitives"][0]; }

void expect_point(const Eigen::Vector3f& found, float x, float y, float z) {
  EXPECT_LT((found - Eigen::Vector3f(x, y, z)).norm(), 1e-6f) << found.transpose();
}

TEST(GltfImport, ReadsTheFlagIntoTheZUpFrame) {
  const ImportedAsset imported = import_built(flag());
  const Asset& asset = imported.asset;
  EXPECT_TRUE(imported.notes.empty());
  EXPECT_EQ(asset.name, "file");
  ASSERT_EQ(asset.mesh.vertices.size(), 4u);
  expect_point(asset.mesh.vertices[0], -1, 0, 0);
  expect_point(asset.mesh.vertices[3], 1, 0, 2);
  EXPECT_EQ(asset.mesh.faces, (std::vector<Triangle>{{0, 1, 2}, {2, 1, 3}}));
  EXPECT_EQ(asset.skeleton.names, (std::vector<std::string>{"hip", "knee"}));
  EXPECT_EQ(asset.skeleton.parents, (std::vector<int>{-1, 0}));
  EXPECT_LT((asset.skeleton.positions()[1] - Eigen::Vector3d(0, 0, 1)).norm(), 1e-12);
  EXPECT_EQ(asset.skin.row(0)[0].joint, 0);
  EXPECT_EQ(asset.skin.row(3)[0].joint, 1);
  EXPECT_TRUE(asset.mesh.normals.empty() && asset.mesh.uvs.empty() && asset.mesh.colors.empty());
}

TEST(GltfImport, GlbAndGltfGiveTheSame) {
  const test::TemporaryFolder folder;
  flag().save(folder / "a.glb");
  flag().save(folder / "a.gltf");
  const Asset a = read_gltf(folder / "a.glb").asset, b = read_gltf(folder / "a.gltf").asset;
  EXPECT_EQ(a.mesh.vertices, b.mesh.vertices);
  EXPECT_EQ(a.mesh.faces, b.mesh.faces);
}

TEST(GltfImport, TriangulatesStripsFansAndUnindexedVertices) {
  GltfBuilder strip = flag();
  primitive(strip)["mode"] = 5;
  primitive(strip)["indices"] = strip.u8({0, 1, 2, 3}, "SCALAR");
  EXPECT_EQ(import_built(strip).asset.mesh.faces, (std::vector<Triangle>{{0, 1, 2}, {1, 3, 2}}));

  GltfBuilder fan = flag();
  primitive(fan)["mode"] = 6;
  primitive(fan)["indices"] = fan.u32({0, 1, 3, 2}, "SCALAR");
  EXPECT_EQ(import_built(fan).asset.mesh.faces, (std::vector<Triangle>{{1, 3, 0}, {3, 2, 0}}));

  GltfBuilder plain = flag();
  primitive(plain).erase("indices");
  const ImportedAsset imported = import_built(plain);
  EXPECT_EQ(imported.asset.mesh.faces, (std::vector<Triangle>{{0, 1, 2}}));
  EXPECT_EQ(note_count(imported, "incomplete_triangles"), 1u);
}

TEST(GltfImport, SkipsLinesAndDegenerateFaces) {
  GltfBuilder file = flag();
  Json lines = primitive(file);
  lines["mode"] = 1;
  file.json["meshes"][0]["primitives"].push_back(lines);
  primitive(file)["indices"] = file.u16({0, 1, 2, 2, 2, 3}, "SCALAR");
  const ImportedAsset imported = import_built(file);
  EXPECT_EQ(imported.asset.mesh.faces.size(), 1u);
  EXPECT_EQ(note_count(imported, "skipped_lines"), 1u);
  EXPECT_EQ(note_count(imported, "degenerate_faces"), 1u);
}

TEST(GltfImport, PrimitivesThatShareVerticesKeepThemOnce) {
  GltfBuilder file = flag();
  Json second = primitive(file);
  second["indices"] = file.u16({3, 1, 2}, "SCALAR");
  file.json["meshes"][0]["primitives"].push_back(second);
  const Mesh mesh = import_built(file).asset.mesh;
  EXPECT_EQ(mesh.vertices.size(), 4u);
  EXPECT_EQ(mesh.faces.size(), 3u);
}

TEST(GltfImport, AppliesSparseAccessors) {
  GltfBuilder file = flag();
  const int indices = file.view(std::string("\x03", 1)), values = file.view(std::string(12, '\0'));
  Json& accessor = file.json["accessors"][0];
  accessor["sparse"] = {{"count", 1},
                        {"indices", {{"bufferView", indices}, {"componentType", 5121}}},
                        {"values", {{"bufferView", values}}}};
  const Mesh mesh = import_built(file).asset.mesh;
  expect_point(mesh.vertices[2], -1, 0, 2);
  expect_point(mesh.vertices[3], 0, 0, 0);

  accessor.erase("bufferView");  // nothing under the replacements but zeros
  accessor["count"] = 4;
  expect_point(import_built(file).asset.mesh.vertices[2], 0, 0, 0);
  accessor["sparse"]["count"] = 5;
  test::expect_refused(file, "/accessors/0/sparse/count", "outside");
}

TEST(GltfImport, ReadsQuantisedAttributes) {
  GltfBuilder file = flag();
  Json& attributes = primitive(file)["attributes"];
  attributes["POSITION"] = file.i16({-32767, 0, 0, 32767, 0, 0, -32767, 16384, 0, 32767, 16384, -32768}, "VEC3", true);
  attributes["WEIGHTS_0"] = file.u8({255, 0, 0, 0, 255, 0, 0, 0, 128, 127, 0, 0, 51, 204, 0, 0}, "VEC4", true);
  attributes["JOINTS_0"] = file.u16({0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0}, "VEC4");
  attributes["TEXCOORD_0"] = file.u16({0, 65535, 0, 0, 0, 0, 13107, 0}, "VEC2", true);
  const ImportedAsset imported = import_built(file);
  const Asset& asset = imported.asset;
  EXPECT_TRUE(imported.notes.empty());
  expect_point(asset.mesh.vertices[3], 1.0f, 1.0f, 16384.0f / 32767.0f);  // −32768 stops at −1
  EXPECT_FLOAT_EQ(asset.mesh.uvs[0].y(), 1.0f);
  EXPECT_FLOAT_EQ(asset.mesh.uvs[3].x(), 0.2f);
  EXPECT_EQ(asset.skin.row(3)[0].joint, 1);
  EXPECT_FLOAT_EQ(asset.skin.row(3)[0].weight, 0.8f);
}

TEST(GltfImport, ReadsInterleavedAttributes) {
  GltfBuilder file = flag();
  std::string bytes;
  for (int v = 0; v < 4; ++v) bytes += file.buffer.substr(static_cast<std::size_t>(12 * v), 12) + std::string(8, 'x');
  const int view = file.view(bytes);
  file.json["bufferViews"][static_cast<std::size_t>(view)]["byteStride"] = 20;
  file.json["accessors"][0]["bufferView"] = view;
  expect_point(import_built(file).asset.mesh.vertices[3], 1, 0, 2);
}

TEST(GltfImport, RepairsWeightsAndCountsThem) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  GltfBuilder file = flag();
  primitive(file)["attributes"]["WEIGHTS_0"] = file.floats({nan, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 1, -1, 0, 0}, "VEC4");
  const ImportedAsset imported = import_built(file);
  EXPECT_EQ(note_count(imported, "nan_weights"), 1u);
  EXPECT_EQ(note_count(imported, "zero_weights"), 1u);
  EXPECT_EQ(note_count(imported, "negative_weights"), 1u);
  EXPECT_EQ(note_count(imported, "unnormalised_weights"), 1u);
  const SkinWeights& skin = imported.asset.skin;
  EXPECT_EQ(skin.row(0)[0].joint, 0);  // like vertex 1, its nearest neighbour with proper weights
  EXPECT_EQ(skin.row(1)[0].joint, 0);
  EXPECT_EQ(skin.row(2)[0].joint, 1);  // like vertex 3
  EXPECT_FLOAT_EQ(skin.row(1)[0].weight, 1.0f);
}

TEST(GltfImport, WithoutAnyWeightsTheNearestJointIsTaken) {
  GltfBuilder file = flag();
  primitive(file)["attributes"]["WEIGHTS_0"] = file.floats(std::vector<float>(16, 0.0f), "VEC4");
  const ImportedAsset imported = import_built(file);
  EXPECT_EQ(note_count(imported, "zero_weights"), 4u);
  EXPECT_EQ(imported.asset.skin.row(0)[0].joint, 0);
  EXPECT_EQ(imported.asset.skin.row(3)[0].joint, 1);
}

TEST(GltfImport, HugeWeightsDoNotOverflow) {
  GltfBuilder file = flag();
  std::vector<float> weights(16, 3e38f);
  primitive(file)["attributes"]["WEIGHTS_0"] = file.floats(weights, "VEC4");
  primitive(file)["attributes"]["JOINTS_0"] = file.u8({0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}, "VEC4");
  EXPECT_FLOAT_EQ(import_built(file).asset.skin.row(0)[0].weight, 0.75f);
}

TEST(GltfImport, AllSetsOfInfluencesCount) {
  GltfBuilder file = flag();
  Json& attributes = primitive(file)["attributes"];
  attributes["WEIGHTS_0"] = file.floats({.5f, 0, 0, 0, .5f, 0, 0, 0, .5f, 0, 0, 0, .5f, 0, 0, 0}, "VEC4");
  attributes["WEIGHTS_1"] = attributes["WEIGHTS_0"];
  attributes["JOINTS_1"] = file.u8({1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}, "VEC4");
  const SkinWeights skin = import_built(file).asset.skin;
  EXPECT_EQ(skin.row_size(0), 2u);
  EXPECT_EQ(skin.row_size(3), 1u);  // the knee twice
  attributes.erase("WEIGHTS_1");
  test::expect_refused(file, "/meshes/0/primitives/0/attributes/JOINTS_1", "WEIGHTS_1");
}

TEST(GltfImport, RefusesJointsOutsideTheSkin) {
  GltfBuilder file = flag();
  primitive(file)["attributes"]["JOINTS_0"] = file.u8({0, 9, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0}, "VEC4");
  test::expect_refused(file, "/meshes/0/primitives/0/attributes/JOINTS_0", "vertex 2 is bound to joint 2");
}

TEST(GltfImport, FillsAttributesThatOnlySomePrimitivesHave) {
  GltfBuilder file = flag();
  Json second = primitive(file);
  second["attributes"]["POSITION"] = file.floats({0, 0, 0, 1, 0, 0, 0, 0, -1, 1, 0, -1}, "VEC3");
  second["attributes"]["NORMAL"] = file.floats({0, 2, 0, 0, 2, 0, 0, 2, 0, 0, 0, 0}, "VEC3");
  second["attributes"]["COLOR_0"] = file.u8({255, 0, 0, 0, 255, 0, 0, 0, 255, 51, 51, 51}, "VEC3", true);
  second["attributes"]["TEXCOORD_0"] = file.floats({0, 0, .5f, .5f, 1, 1, NAN, 0}, "VEC2");
  file.json["meshes"][0]["primitives"].push_back(second);
  const ImportedAsset imported = import_built(file);
  const Mesh& mesh = imported.asset.mesh;
  ASSERT_EQ(mesh.normals.size(), 8u);
  expect_point(mesh.normals[0], 0, -1, 0);  // of the face, which looks along glTF's +Z
  expect_point(mesh.normals[4], 0, 0, 1);
  expect_point(mesh.normals[7], 0, 0, 1);  // no length in the file: taken from the faces
  EXPECT_EQ(note_count(imported, "computed_normals"), 5u);
  EXPECT_EQ(mesh.colors[0], Eigen::Vector4f(1, 1, 1, 1));
  EXPECT_EQ(mesh.colors[4], Eigen::Vector4f(1, 0, 0, 1));
  EXPECT_FLOAT_EQ(mesh.colors[7].x(), 0.2f);
  EXPECT_EQ(mesh.uvs[0], Eigen::Vector2f(0, 0));
  EXPECT_EQ(mesh.uvs[7], Eigen::Vector2f(0, 0));
  EXPECT_TRUE(has_note(imported, "repaired_uvs"));
}

TEST(GltfImport, ReadsMaterialsTexturesAndTheirTransforms) {
  const test::TemporaryFolder folder;
  GltfBuilder file = flag();
  const std::vector<std::uint8_t> png = test::tiny_png();
  test::write_bytes(folder / "a picture.png", std::string(png.begin(), png.end()));
  primitive(file)["attributes"]["TEXCOORD_0"] = file.floats({0, 0, 0, 0, 0, 0, 0, 0}, "VEC2");
  primitive(file)["attributes"]["TEXCOORD_1"] = file.floats({0, 0, 1, 0, 0, 1, 1, 1}, "VEC2");
  primitive(file)["material"] = 1;
  const Json transform = {{"KHR_texture_transform", {{"offset", {.25, .5}}, {"scale", {2, 4}}}}};
  Json pbr = {{"baseColorFactor", {1, .5, .25, 2}},
              {"baseColorTexture", {{"index", 0}, {"texCoord", 1}, {"extensions", transform}}}};
  file.json["materials"] =
      Json::array({Json{{"name", "plain"}, {"doubleSided", true}, {"alphaMode", "MASK"}, {"alphaCutoff", 0.25}},
                   Json{{"pbrMetallicRoughness", pbr}}});
  file.json["textures"] = Json::array({Json{{"source", 1}}});
  file.json["images"] = Json::array({Json{{"uri", "nowhere.png"}}, Json{{"uri", "a%20picture.png"}}});
  file.save(folder / "file.gltf");
  const ImportedAsset imported = read_gltf(folder / "file.gltf");
  const Asset& asset = imported.asset;
  ASSERT_EQ(asset.materials.size(), 2u);
  EXPECT_TRUE(asset.materials[0].double_sided);
  EXPECT_EQ(asset.materials[0].alpha_mode, AlphaMode::kMask);
  EXPECT_EQ(asset.materials[0].alpha_cutoff, 0.25f);
  EXPECT_EQ(asset.materials[1].alpha_mode, AlphaMode::kOpaque);
  EXPECT_EQ(asset.materials[1].base_color, Eigen::Vector4f(1, .5f, .25f, 1));
  ASSERT_EQ(asset.images.size(), 1u);
  EXPECT_EQ(asset.materials[1].image, 0);
  EXPECT_EQ(asset.images[0].mime_type, "image/png");
  EXPECT_EQ(asset.images[0].bytes, png);
  EXPECT_EQ(asset.mesh.face_materials, (std::vector<std::int32_t>{1, 1}));
  EXPECT_EQ(asset.mesh.uvs[3], Eigen::Vector2f(2.25f, 4.5f));
  EXPECT_TRUE(has_note(imported, "texture_transform"));

  file.json["textures"][0]["source"] = 0;
  file.save(folder / "file.gltf");
  const ImportedAsset without = read_gltf(folder / "file.gltf");
  EXPECT_EQ(without.asset.materials[1].image, -1);
  EXPECT_TRUE(has_note(without, "missing_image"));
}

TEST(GltfImport, ReadsExternalBuffers) {
  const test::TemporaryFolder folder;
  std::filesystem::create_directories(folder / "data");
  GltfBuilder file = flag();
  test::write_bytes(folder / "data/numbers.bin", file.buffer);
  file.json["buffers"] = Json::array({Json{{"byteLength", file.buffer.size()}, {"uri", "data/./numbers.bin"}}});
  test::write_bytes(folder / "file.gltf", file.json.dump());
  EXPECT_EQ(read_gltf(folder / "file.gltf").asset.mesh.vertices.size(), 4u);
}

TEST(GltfImport, ImportsOneScene) {
  GltfBuilder file = flag();
  file.json["nodes"].push_back({{"mesh", 1}, {"skin", 0}});
  Json other = file.json["meshes"][0];
  other["primitives"][0]["indices"] = file.u16({0, 1, 2}, "SCALAR");
  file.json["meshes"].push_back(other);
  file.json["scenes"].push_back({{"nodes", {3, 1}}});
  ImportOptions options;
  EXPECT_EQ(import_built(file).asset.mesh.faces.size(), 2u);
  options.scene = 1;
  EXPECT_EQ(import_built(file, options).asset.mesh.faces.size(), 1u);
  options.scene = 2;
  test::expect_refused(file, "/", "scene 2", options);
  file.json.erase("scenes");
  file.json.erase("scene");
  EXPECT_EQ(import_built(file).asset.mesh.faces.size(), 3u);
}

TEST(GltfImport, MeshesWithoutSkinFollowAJoint) {
  GltfBuilder file = flag();
  file.json["meshes"].push_back(
      {{"primitives", Json::array({Json{{"attributes", {{"POSITION", 0}}}, {"indices", 3}}})}});
  file.json["nodes"][2]["children"] = {3};
  file.json["nodes"].push_back({{"translation", {5, 0, 0}}, {"children", {4}}});
  file.json["nodes"].push_back({{"mesh", 1}});
  file.json["nodes"].push_back({{"mesh", 1}, {"scale", {-1, 1, 1}}, {"translation", {0, 0, 7}}});
  file.json["scenes"][0]["nodes"].push_back(5);
  const ImportedAsset imported = import_built(file);
  const Asset& asset = imported.asset;
  ASSERT_EQ(asset.mesh.vertices.size(), 12u);
  expect_point(asset.mesh.vertices[4], 4, 0, 1);
  EXPECT_EQ(asset.skin.row(4)[0].joint, 1);
  expect_point(asset.mesh.vertices[8], 1, -7, 0);
  EXPECT_EQ(asset.skin.row(8)[0].joint, 0);
  EXPECT_EQ(asset.mesh.faces[4], (Triangle{8, 10, 9}));  // mirrored, so turned around
  EXPECT_EQ(note_count(imported, "rigid_mesh_on_joint"), 1u);
  EXPECT_EQ(note_count(imported, "unskinned_mesh"), 1u);
}

TEST(GltfImport, NotesMorphTargets) {
  GltfBuilder file = flag();
  primitive(file)["targets"] = Json::array({Json{{"POSITION", 0}}});
  EXPECT_TRUE(has_note(import_built(file), "morph_targets"));
}

TEST(GltfImport, NamesTheExtensionItLacks) {
  GltfBuilder file = flag();
  file.json["extensionsUsed"] = {"KHR_materials_unlit", "VENDOR_other"};
  EXPECT_NO_THROW(import_built(file));
  file.json["extensionsRequired"] = {"KHR_mesh_quantization", "VENDOR_needed"};
  test::expect_refused(file, "/extensionsRequired/1", "not supported: extension VENDOR_needed");
  file.json.erase("extensionsRequired");
  file.json["asset"]["version"] = "1.0";
  test::expect_refused(file, "/asset", "not supported: glTF version '1.0'");
}

TEST(GltfImport, RespectsTheLimits) {
  ImportOptions options;
  options.max_vertices = 3;
  test::expect_refused(flag(), "/meshes/0/primitives/0", "vertices", options);
  options = {};
  options.max_faces = 1;
  test::expect_refused(flag(), "/meshes/0/primitives/0", "faces", options);
  options = {};
  options.max_joints = 1;
  test::expect_refused(flag(), "/skins", "joints", options);
  options = {};
  options.max_nodes = 2;
  test::expect_refused(flag(), "/nodes", "nodes", options);
  options = {};
  options.max_file_bytes = 100;
  test::expect_refused(flag(), "", "exceeds the limit", options);
}

}  // namespace

}  // namespace anigen::io
