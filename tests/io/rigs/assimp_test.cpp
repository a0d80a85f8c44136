// FBX and COLLADA through Assimp: the same rig must come out of both as of every other format.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <fstream>
#include <functional>
#include <iterator>
#include <thread>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/sandbox.h"
#include "anigen/io/rigs/assimp.h"
#include "anigen/io/rigs/assimp_scene.h"
#include "anigen/io/rigs/read_assimp.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "tests/io/small_asset.h"
#include "tests/support/paths.h"
#include "tests/support/scene_files.h"

namespace anigen::io {
namespace {

namespace fs = std::filesystem;
using test::RigFile;
using test::SceneOptions;

enum class Format { kCollada, kFbx };

class Scenes : public testing::TestWithParam<Format> {
 protected:
  bool is_fbx() const { return GetParam() == Format::kFbx; }
  std::string text(const SceneOptions& options = {}) const {
    return is_fbx() ? test::fbx_text(rig_, options) : test::collada_text(rig_, options);
  }
  fs::path write(const std::string& content) const {
    const fs::path file = folder_ / (is_fbx() ? "sample.fbx" : "sample.dae");
    write_file_atomically(file, content);
    return file;
  }
  ImportedAsset read(const SceneOptions& options = {}) const { return read_assimp(write(text(options))); }
  std::string refusal(const std::string& content, const ImportOptions& options = {}) const {
    const fs::path file = write(content);
    try {
      read_assimp(file, options);
    } catch (const InputError& error) {
      EXPECT_EQ(error.file(), file.string());
      return error.what();
    }
    return "";
  }

  test::TemporaryFolder folder_;
  RigFile rig_;
};

INSTANTIATE_TEST_SUITE_P(Formats, Scenes, testing::Values(Format::kCollada, Format::kFbx),
                         [](const auto& info) { return info.param == Format::kFbx ? "Fbx" : "Collada"; });

/// Weight of the vertex nearest to a place for the joint of that name.
float weight_at(const Asset& asset, const Eigen::Vector3f& place, const std::string& joint) {
  std::size_t best = 0;
  for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) {
    if ((asset.mesh.vertices[v] - place).norm() < (asset.mesh.vertices[best] - place).norm()) best = v;
  }
  for (std::size_t i = 0; i < asset.skin.row_size(best); ++i) {
    const Influence& influence = asset.skin.row(best)[i];
    if (asset.skeleton.names[static_cast<std::size_t>(influence.joint)] == joint) return influence.weight;
  }
  return 0.0f;
}

void expect_rig(const Asset& asset, const RigFile& rig, double unit) {
  EXPECT_TRUE(validate(asset).empty());
  ASSERT_EQ(asset.skeleton.names, (std::vector<std::string>{"j0", "j1", "j2"}));
  EXPECT_EQ(asset.skeleton.parents, rig.parents);
  const std::vector<Eigen::Vector3d> joints = asset.skeleton.positions();
  for (std::size_t j = 0; j < 3; ++j) {
    const Eigen::Vector3d expected(rig.joints[3 * j], rig.joints[3 * j + 1], rig.joints[3 * j + 2]);
    EXPECT_LT((joints[j] - unit * expected).norm(), 1e-5 * unit) << j;
  }
  EXPECT_EQ(asset.mesh.vertices.size(), 6u) << "corners that agree are one vertex";
  EXPECT_EQ(asset.mesh.faces.size(), 4u);
  for (std::size_t v = 0; v < 6; ++v) {
    const Eigen::Vector3f place =
        static_cast<float>(unit) *
        Eigen::Vector3f(rig.vertices[3 * v], rig.vertices[3 * v + 1], rig.vertices[3 * v + 2]);
    for (std::size_t j = 0; j < 3; ++j)
      EXPECT_NEAR(weight_at(asset, place, "j" + std::to_string(j)), rig.skin[3 * v + j], 1e-5) << v << " " << j;
  }
  // The rest pose is the bind pose.
  const std::vector<Eigen::Vector3f> rest = skin_vertices(asset, asset.skeleton.rest);
  for (std::size_t v = 0; v < rest.size(); ++v) EXPECT_LT((rest[v] - asset.mesh.vertices[v]).norm(), 1e-5 * unit);
}

TEST_P(Scenes, GiveTheRig) {
  const ImportedAsset imported = read();
  expect_rig(imported.asset, rig_, 1.0);
  EXPECT_EQ(imported.lowest_weight_sum, 1.0);
  ASSERT_FALSE(imported.asset.materials.empty());
  const Eigen::Vector4f& color = imported.asset.materials[0].base_color;
  EXPECT_LT((color - Eigen::Vector4f(0.25f, 0.5f, 0.75f, 1.0f)).norm(), 1e-5);
}

/// The text without what binds the mesh to the joints.
std::string without_skin(std::string text, bool is_fbx) {
  if (is_fbx) {
    for (std::size_t at; (at = text.find("Deformer: ")) != std::string::npos;) text.replace(at, 10, "Nothing: ");
    return text;
  }
  const std::string controller = "<instance_controller url=\"#skin\"><skeleton>#j0</skeleton>";
  text.replace(text.find(controller), controller.size(), "<instance_geometry url=\"#mesh\">");
  const std::string end = "</instance_controller>";
  text.replace(text.find(end), end.size(), "</instance_geometry>");
  return text;
}

TEST_P(Scenes, WithoutASkinAreMeshesWhereTheCallerWantsThem) {
  SceneOptions scene;
  scene.unit = 0.01;
  const std::string content = without_skin(text(scene), is_fbx());
  EXPECT_NE(refusal(content).find("no skin"), std::string::npos);
  ImportOptions options;
  options.require_rig = false;
  const ImportedAsset imported = read_assimp(write(content), options);
  EXPECT_EQ(imported.asset.skeleton.size(), 0u);
  EXPECT_EQ(imported.asset.skin.rows(), 0u);
  EXPECT_EQ(imported.asset.mesh.faces.size(), 4u);
  EXPECT_NEAR(bounding_box(imported.asset.mesh.vertices).longest_side(), 0.01, 1e-6) << "metres, Z up";
  EXPECT_EQ(imported.frame.up, 'Z');
  EXPECT_NEAR(imported.frame.metres, 0.01, 1e-9);
  ASSERT_EQ(imported.node_clips.size(), 1u);
  EXPECT_NEAR(imported.node_clips[0].seconds, 1.0, 1e-5);
}

TEST_P(Scenes, WithoutAMeshAreSkeletonsOfWhatMoves) {
  std::string content = without_skin(text(), is_fbx());
  if (is_fbx()) {
    content.replace(content.find("Geometry: "), 10, "Nothing: ");
  } else {
    const std::size_t begin = content.find("<instance_geometry"), end = content.find("</instance_geometry>") + 20;
    content.erase(begin, end - begin);
  }
  ImportOptions options;
  options.require_rig = false;
  const Asset asset = read_assimp(write(content), options).asset;
  EXPECT_TRUE(asset.mesh.vertices.empty());
  EXPECT_EQ(asset.skeleton.names, (std::vector<std::string>{"j1", "j2"})) << "j1 turns, j2 hangs on it";
  ASSERT_EQ(asset.animations.size(), 1u);
  EXPECT_NEAR(asset.animations[0].duration(), 1.0, 1e-5);
}

TEST_P(Scenes, UnitsBecomeMetres) {
  SceneOptions options;
  options.unit = 0.01;
  expect_rig(read(options).asset, rig_, 0.01);
}

TEST_P(Scenes, AnimationsMoveJoints) {
  const Asset asset = read().asset;
  ASSERT_EQ(asset.animations.size(), 1u);
  EXPECT_NEAR(asset.animations[0].duration(), 1.0, 1e-5);
  const Pose pose = sample(asset.animations[0], asset.skeleton, 1.0);
  const Eigen::Matrix4d end = forward_kinematics(asset.skeleton.parents, pose)[2];
  EXPECT_LT((end.topRightCorner<3, 1>() - Eigen::Vector3d(0, -0.5, 0.5)).norm(), 1e-5);
}

TEST_P(Scenes, TexturesBesideTheFileAreFound) {
  SceneOptions options;
  // As exporters write them; COLLADA knows forward slashes only.
  options.diffuse_texture = is_fbx() ? "C:\\work\\someone\\my skin.png" : "./my%20skin.png";
  EXPECT_TRUE(read(options).asset.images.empty());
  const std::vector<std::uint8_t> png = test::tiny_png();
  write_file_atomically(folder_ / "my skin.png", std::string(png.begin(), png.end()));
  const Asset asset = read(options).asset;
  ASSERT_EQ(asset.images.size(), 1u);
  EXPECT_EQ(asset.images[0].bytes, png);
  EXPECT_EQ(asset.images[0].mime_type, "image/png");
  EXPECT_EQ(asset.materials.at(0).image, 0);
}

TEST_P(Scenes, WeightsAreRepairedAndTold) {
  rig_.skin[0] = 0.5f;  // vertex 0 sums to a half
  rig_.skin[3] = 0.0f;  // vertex 1 has none
  const ImportedAsset imported = read();
  EXPECT_TRUE(validate(imported.asset).empty());
  EXPECT_NEAR(imported.lowest_weight_sum, 0.5, 1e-6);
  std::string codes;
  for (const ImportNote& note : imported.notes) codes += note.code + " ";
  EXPECT_NE(codes.find("zero_weights"), std::string::npos) << codes;
  EXPECT_NE(codes.find("unnormalised_weights"), std::string::npos) << codes;
}

TEST_P(Scenes, AreSourcesOfShapes) {
  const fs::path file = write(text());
  const auto source = open_source(file);
  EXPECT_EQ(source->ids(), std::vector<std::string>{"sample"});
  EXPECT_TRUE(source->read("sample").has_skin());
}

TEST_P(Scenes, TruncatedFilesAreRefusedOrSound) {
  const std::string whole = text();
  for (std::size_t part = 1; part < 24; ++part) {
    const fs::path file = write(whole.substr(0, whole.size() * part / 24));
    try {
      EXPECT_TRUE(validate(read_assimp(file).asset).empty()) << part;
    } catch (const InputError& error) {
      EXPECT_EQ(error.file(), file.string());
    }
  }
}

TEST_P(Scenes, LimitsHold) {
  ImportOptions options;
  options.max_vertices = 5;
  EXPECT_NE(refusal(text(), options).find("vertices"), std::string::npos);
  options = {};
  options.max_faces = 3;
  EXPECT_NE(refusal(text(), options).find("faces"), std::string::npos);
  options = {};
  options.max_joints = 2;
  EXPECT_NE(refusal(text(), options).find("3 joints exceed the limit of 2"), std::string::npos);
  options = {};
  options.max_nodes = 2;
  EXPECT_NE(refusal(text(), options).find("nodes"), std::string::npos);
  options = {};
  options.max_file_bytes = 100;
  EXPECT_FALSE(refusal(text(), options).empty());
  EXPECT_FALSE(refusal("").empty());
  EXPECT_FALSE(refusal("hello").empty());
}

TEST(Fbx, PivotsAreFoldedIntoTheirJoint) {
  const test::TemporaryFolder folder;
  const RigFile rig;
  SceneOptions options;
  options.pre_rotation = 30;
  write_file_atomically(folder / "a.fbx", test::fbx_text(rig, options));
  const Asset asset = read_assimp(folder / "a.fbx").asset;
  expect_rig(asset, rig, 1.0);
  const Pose pose = sample(asset.animations.at(0), asset.skeleton, 1.0);
  const Eigen::Matrix4d end = forward_kinematics(asset.skeleton.parents, pose)[2];
  // Joint 1 turns its z axis to −y, and −y by 30° about z.
  EXPECT_LT((end.topRightCorner<3, 1>() - Eigen::Vector3d(0.25, -0.4330127, 0.5)).norm(), 1e-5);
}

TEST(Collada, BonesWithoutNodesAreNamed) {
  const test::TemporaryFolder folder;
  SceneOptions options;
  options.bone_name = "nobody";
  write_file_atomically(folder / "a.dae", test::collada_text(RigFile(), options));
  EXPECT_THROW(read_assimp(folder / "a.dae"), InputError);
}

std::string problem(const std::function<void()>& action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.problem();
  }
  return "";
}

TEST(ColladaScan, RefusesWhatRecursionCannotStand) {
  std::string deep;
  for (int i = 0; i < 100'000; ++i) deep += "<node>";
  EXPECT_EQ(problem([&] { assimp_import::scan_collada(deep, "f"); }), "elements are nested deeper than 1024");
  EXPECT_EQ(problem([] {
              assimp_import::scan_collada("<node id='a'><node id='b'><instance_node url='#a'/></node></node>", "f");
            }),
            "a node is its own ancestor: the scene graph has a cycle");
  std::string doubling = "<node id='n0'/>";  // every node has the one before twice
  for (int i = 1; i < 40; ++i) {
    const std::string url = "<instance_node url='#n" + std::to_string(i - 1) + "'/>";
    doubling += "<node id='n" + std::to_string(i) + "'>" + url + url + "</node>";
  }
  EXPECT_EQ(problem([&] { assimp_import::scan_collada(doubling, "f", 1000); }),
            "the scene graph has more nodes than the limit of 1000");
  EXPECT_EQ(problem([] { assimp_import::scan_collada(std::string("\xFF\xFE<\0a\0", 6), "f"); }),
            "not supported: text in UTF-16; convert it: iconv -f UTF-16 -t UTF-8");
  std::string flat = "<?xml?><!-- <x> --><![CDATA[ <y> ]]>";
  for (int i = 0; i < 5'000; ++i) flat += "<node a='>'/><node></node>";
  EXPECT_EQ(problem([&] { assimp_import::scan_collada(flat, "f"); }), "");
}

TEST(ColladaScan, ReadsAxisAndUnitOfTheScene) {
  const FileFrame frame = assimp_import::scan_collada(
      "<COLLADA><asset><unit name='inch' meter=\"0.0254\"/><up_axis> X_UP </up_axis></asset><library><part><asset>"
      "<unit meter='7'/><up_axis>Y_UP</up_axis></asset></part></library></COLLADA>",
      "f");
  EXPECT_EQ(frame.up, 'X');
  EXPECT_EQ(frame.metres, 0.0254);
}

// Assimp 5.2 takes the blank for a number that is none. Exporters of Godot's users write such files.
TEST(Collada, NumbersMayBeginWithBlanks) {
  const test::TemporaryFolder folder;
  std::string text = test::collada_text(RigFile());
  for (const std::string tag : {"<color>", "<bind_shape_matrix>", "<vcount>", "<v>", "<p>"}) {
    ASSERT_NE(text.find(tag), std::string::npos) << tag;
    text.insert(text.find(tag) + tag.size(), "\n\t ");
  }
  write_file_atomically(folder / "a.dae", text);
  const Asset asset = read_assimp(folder / "a.dae").asset;
  expect_rig(asset, RigFile(), 1.0);
  EXPECT_LT((asset.materials.at(0).base_color - Eigen::Vector4f(0.25f, 0.5f, 0.75f, 1.0f)).norm(), 1e-5);
}

TEST(Collada, NodesShownAgainAreRead) {
  const test::TemporaryFolder folder;
  std::string text = test::collada_text(RigFile());
  const std::string extra = "<node id=\"again\"><instance_node url=\"#lamp\"/></node>";
  text.insert(text.find("<library_visual_scenes>"), "<library_nodes><node id=\"lamp\"/></library_nodes>");
  text.insert(text.find("\n<node id=\"body\""), extra);
  write_file_atomically(folder / "a.dae", text);
  EXPECT_EQ(read_assimp(folder / "a.dae").asset.skeleton.size(), 3u);
}

// A picture inside the file that is no base64 makes Assimp 5.2 free memory that it never asked for.
// Assimp 5.2 writes past a buffer for the '?' in the base64 text: it crashes or not, as the heap lies. This process
// goes on in both cases; GuardedProcess tests hold a crash that is certain.
TEST(Fbx, WhatMayCrashAssimpIsRefused) {
  const test::TemporaryFolder folder;
  write_file_atomically(
      folder / "a.fbx",
      "; FBX 7.4.0 project file\nFBXHeaderExtension:  {\n\tFBXHeaderVersion: 1003\n\tFBXVersion: 7400\n}\n"
      "GlobalSettings:  {\n\tVersion: 1000\n}\nObjects:  {\n"
      "Material: 300, \"Material::skin\", \"\" {\n}\nModel: 100, \"Model::m\", \"Mesh\" {\n}\n"
      "Texture: 400, \"Texture::t\", \"\" {\n\tFileName: \"a.png\"\n\tRelativeFilename: \"a.png\"\n}\n"
      "Video: 500, \"Video::v\", \"Clip\" {\n\tFilename: \"a.png\"\n\tRelativeFilename: \"a.png\"\n"
      "\tContent: ,\n \"AAAA?AAA\"\n}\n"
      "Geometry: 1000, \"Geometry::g\", \"Mesh\" {\n\tVertices: *9 {\n\ta: 0,0,0,1,0,0,0,1,0\n\t}\n"
      "\tPolygonVertexIndex: *3 {\n\ta: 0,1,-3\n\t}\n}\n}\n"
      "Connections:  {\nC: \"OO\",100,0\nC: \"OO\",1000,100\nC: \"OO\",300,100\n"
      "C: \"OP\",400,300, \"DiffuseColor\"\nC: \"OO\",500,400\n}\n");
  const std::string refused = problem([&] { read_assimp(folder / "a.fbx"); });
  const bool crashed = refused.rfind("Assimp cannot read it: it crashed (", 0) == 0;
  EXPECT_TRUE(crashed || refused == "no skin: nothing to animate; export the mesh with its armature") << refused;
}

std::string fbx_graph(const std::string& models, const std::string& links) {
  return "Objects: {\n" + models + "}\nConnections: {\n" + links + "}\n";
}

TEST(FbxScan, RefusesCyclesDepthAndGrowth) {
  const auto refused = [](const std::string& text) {
    return problem([&] { assimp_import::scan_fbx(text, 100'000, "f"); });
  };
  std::string models, chain = "C: \"OO\",1,0\n", wide = chain;
  for (int i = 1; i <= 3000; ++i) {
    models += "Model: " + std::to_string(i) + ", \"Model::m\", \"Null\" {\n}\n";
    if (i > 1) chain += "C: \"OO\"," + std::to_string(i) + "," + std::to_string(i - 1) + "\n";
    if (i > 1) wide += "C: \"OO\"," + std::to_string(i) + ",1\n";
  }
  EXPECT_EQ(refused(fbx_graph(models, wide)), "");
  EXPECT_EQ(refused(fbx_graph(models, chain)), "models are nested deeper than 1024");
  EXPECT_EQ(refused(fbx_graph(models, "C: \"OO\",1,0\nC: \"OO\",2,1\nC: \"OO\",1,2\n")),
            "a model is its own ancestor: the scene graph has a cycle");
  std::string doubling = "C: \"OO\",1,0\n";  // every model hangs twice on the one before
  for (int i = 2; i < 40; ++i) {
    for (int twice = 0; twice < 2; ++twice)
      doubling += "C: \"OO\"," + std::to_string(i) + "," + std::to_string(i - 1) + "\n";
  }
  EXPECT_EQ(refused(fbx_graph(models, doubling)), "the scene graph has more nodes than the limit of 100000");
  EXPECT_EQ(refused(std::string(1000, '{')), "blocks are nested deeper than 64");
}

// Id as Assimp reads it: the digits in front of a token, without a sign, up to 64 bits.
TEST(FbxScan, ReadsIdsAsAssimpDoes) {
  const std::string models = "Model: 1, \"Model::m\", \"Null\" {\n}\nModel: 2, \"Model::m\", \"Null\" {\n}\n";
  const auto refused = [&](const std::string& links) {
    return problem([&] { assimp_import::scan_fbx(fbx_graph(models, "C: \"OO\",1,0\n" + links), 1000, "f"); });
  };
  const std::string cycle = "a model is its own ancestor: the scene graph has a cycle";
  EXPECT_EQ(refused("C: \"OO\",2x,1x\nC: \"OO\",1,2\n"), cycle);
  EXPECT_EQ(refused("C: \"OO\",2.0,1.0\nC: \"OO\",1,2\n"), cycle);
}

TEST(ColladaScan, DoesNotLoseItsPlaceInQuotes) {
  std::string deep;
  for (int i = 0; i < 2000; ++i) deep += "<a>";
  const auto refused = [&](const std::string& before) {
    return problem([&] { assimp_import::scan_collada("<?xml version='1.0'?>" + before + deep, "f"); });
  };
  const std::string nested = "elements are nested deeper than 1024";
  EXPECT_EQ(refused(""), nested);
  EXPECT_EQ(refused("<?x ' ?>"), nested);
  EXPECT_EQ(refused("<!--><x ' -->"), nested);
  EXPECT_NE(refused("<!DOCTYPE a [<!-- ' -->]>").find("not supported"), std::string::npos);
  EXPECT_EQ(refused("<x ' "), "a tag is not closed");
}

/// A record of a binary FBX file (version 7400): offsets of 32 bits.
std::string record(std::size_t at, const std::string& name, const std::string& properties, const std::string& inside) {
  const auto little = [](std::size_t value) {
    std::string bytes;
    for (int i = 0; i < 4; ++i) bytes += static_cast<char>(value >> (8 * i) & 0xFF);
    return bytes;
  };
  const std::size_t head = 13 + name.size() + properties.size();
  return little(at + head + inside.size()) + little(0) + little(properties.size()) + static_cast<char>(name.size()) +
         name + properties + inside;
}

/// Lines of /proc/<id>/status of the processes that this one has started.
std::string status_of_children() {
  std::string text;
  for (const fs::directory_entry& task : fs::directory_iterator("/proc/self/task")) {
    std::ifstream children(task.path() / "children");
    for (std::string child; children >> child;) {
      std::ifstream file("/proc/" + child + "/status");
      try {
        text.append(std::istreambuf_iterator<char>(file), {});
      } catch (const std::ios_base::failure&) {
        continue;  // the process has ended since its file was opened
      }
    }
  }
  return text;
}

TEST(AssimpProcess, HasNoRights) {
  if (!sandbox_means().calls) GTEST_SKIP() << "this kernel has no seccomp filters";
  const test::TemporaryFolder folder;
  write_file_atomically(folder / "a.dae", test::collada_text(RigFile()));
  std::atomic<bool> done{false}, held{false};
  std::thread watch([&] {
    while (!done && !held) {
      const std::string status = status_of_children();
      held = status.find("NoNewPrivs:\t1\n") != std::string::npos && status.find("Seccomp:\t2\n") != std::string::npos;
    }
  });
  const auto begin = std::chrono::steady_clock::now();
  while (!held && std::chrono::steady_clock::now() - begin < std::chrono::seconds(20)) read_assimp(folder / "a.dae");
  done = true;
  watch.join();
  EXPECT_TRUE(held);
}

TEST(FbxScan, ReadsBinaryFiles) {
  const std::string header = std::string("Kaydara FBX Binary  \0\x1A\0", 23) + std::string("\xE8\x1C\0\0", 4);
  const auto refused = [](const std::string& bytes) {
    return problem([&] { assimp_import::scan_fbx(bytes, 1000, "f"); });
  };
  const auto id = [](char value) { return std::string("L") + value + std::string(7, '\0'); };
  const auto link = [&](char child, char parent) { return std::string("S\2\0\0\0OO", 7) + id(child) + id(parent); };
  const auto file = [&](const std::vector<std::pair<char, char>>& links) {
    std::string bytes = header, inside;
    std::size_t at = bytes.size() + 13 + 7;
    for (const char model : {1, 2}) inside += record(at + inside.size(), "Model", id(model), "");
    bytes += record(bytes.size(), "Objects", "", inside);
    inside.clear();
    at = bytes.size() + 13 + 11;
    for (const auto& [child, parent] : links) inside += record(at + inside.size(), "C", link(child, parent), "");
    return bytes + record(bytes.size(), "Connections", "", inside) + std::string(13, '\0');
  };
  EXPECT_EQ(refused(file({{1, 0}, {2, 1}})), "");
  EXPECT_EQ(refused(file({{1, 0}, {2, 1}, {1, 2}})), "a model is its own ancestor: the scene graph has a cycle");
  std::string beyond = file({{1, 0}});
  beyond[27] = '\xFF';
  beyond[28] = '\xFF';
  EXPECT_EQ(refused(beyond), "a record does not end inside the one around it");
  // Assimp goes on behind an empty record in the middle of a list.
  std::string hidden = header, empty_first(13, '\0');
  empty_first += record(hidden.size() + 13 + 7 + 13, "Model", id(1), "");
  hidden += record(hidden.size(), "Objects", "", empty_first) + std::string(13, '\0');
  EXPECT_EQ(refused(hidden), "an empty record stands in the middle of a list");
  // Arrays that say they unpack to 6 × 1 GiB in a few bytes.
  const std::string array = std::string("d\xFF\xFF\xFF\x07\1\0\0\0\0\0\0\0", 13);
  std::string arrays;
  for (int k = 0; k < 6; ++k) arrays += array;
  EXPECT_EQ(refused(header + record(header.size(), "Vertices", arrays, "") + std::string(13, '\0')),
            "the arrays up to here unpack to more than 4 GiB");
  EXPECT_EQ(refused(header.substr(0, 22)), "the header is cut short");
}

}  // namespace
}  // namespace anigen::io
