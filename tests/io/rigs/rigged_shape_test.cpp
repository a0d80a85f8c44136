#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <ostream>
#include <set>

#include "anigen/core/error.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/obj.h"
#include "anigen/io/ply.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "tests/io/arrays/array_file_bytes.h"
#include "tests/support/rig_files.h"

namespace anigen::io {

namespace {

namespace fs = std::filesystem;
using test::RigFile;

using Writer = void (*)(const fs::path& folder, const RigFile& rig);

/// The four formats that can say anything, sound or not.
const std::map<std::string, std::pair<const char*, Writer>>& formats() {
  static const std::map<std::string, std::pair<const char*, Writer>> all = {
      {"npz", {"sample.npz", [](const fs::path& file, const RigFile& rig) { test::write_rig_npz(file, rig); }}},
      {"xl", {"xl.npz", [](const fs::path& file, const RigFile& rig) { test::write_articulation_xl(file, {rig}); }}},
      {"text", {"sample.txt", [](const fs::path& file, const RigFile& rig) { test::write_text_rig(file, rig); }}},
      {"pt", {"list.pt", [](const fs::path& file, const RigFile& rig) { test::write_anymate(file, {rig}); }}}};
  return all;
}

struct Case {
  const char* name;
  void (*damage)(RigFile& rig);
  std::map<std::string, std::string> refusals;  ///< by format: place and problem; formats left out read it
  std::string note;                             ///< among the notes of formats that read it
  std::size_t joints, faces;                    ///< that they then have
  bool has_skin;
};

void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

/// Error of each kind of bad input, by format. Positions of joints count from 0, lines from 1.
const std::vector<Case>& cases() {
  static const std::vector<Case> all = {
      {"empty_skeleton",
       [](RigFile& rig) {
         rig.keep_joints(0);
         rig.has_skin = false;
       },
       {{"npz", "the skeleton has no joint"},
        {"xl", "sample sample: the skeleton has no joint"},
        {"text", "the skeleton has no joint"},
        {"pt", "sample sample: the skeleton has no joint"}},
       "",
       0,
       0,
       false},
      {"no_skeleton_in_file",
       [](RigFile& rig) { rig.has_skeleton = rig.has_skin = false; },
       {{"text", "the skeleton has no joint"}},
       "no skeleton: skeleton and skin metrics are not computed",
       0,
       4,
       false},
      {"single_joint",
       [](RigFile& rig) {
         rig.keep_joints(1);
         rig.skin.assign(6, 1.0f);
       },
       {{"pt", "sample sample, mesh_skins_index[0]: names bone 0 of 0"}},
       "",
       1,
       4,
       true},
      {"forest",
       [](RigFile& rig) {
         rig.parents = {-1, 0, -1};
       },
       {{"pt", "sample sample, mesh_skins_index[2]: names bone 1 of 1"}},
       "a forest of 2 trees",
       3,
       4,
       true},
      {"two_identical_joints",
       [](RigFile& rig) {
         rig.joints = {0, 0, 0, 0, 0, 0.5, 0, 0, 0.5};
         rig.has_skin = false;
       },
       {},
       "1 joints lie exactly where another one does",
       3,
       4,
       false},
      {"nan_joint",
       [](RigFile& rig) { rig.joints[4] = std::nan(""); },
       {{"npz", "joints[1]: is not finite"},
        {"xl", "sample sample, joints[1]: is not finite"},
        {"text", "line 2: \"nan\" is not finite"},
        {"pt", "sample sample, joints[1]: is not finite"}},
       "",
       0,
       0,
       false},
      {"weights_for_too_few_vertices",
       [](RigFile& rig) {
         rig.skin.resize(15);
         rig.skin_rows = 5;
       },
       {{"npz", "skin: its shape is [5, 3], expected [6, 3]"},
        {"xl", "sample sample, skinning_weights_shape: weights for 5 vertices and 3 joints, but there are 6 and 3"},
        {"pt", "sample sample, mesh_skins_index: its shape is [5, 3], expected [6, any]"}},
       "1 vertices without a weight are bound to joint 0",  // a text rig leaves out what weighs nothing
       3,
       4,
       true},
      {"weights_for_too_many_vertices",
       [](RigFile& rig) {
         rig.skin.insert(rig.skin.end(), {1, 0, 0});
         rig.skin_rows = 7;
       },
       {{"npz", "skin: its shape is [7, 3], expected [6, 3]"},
        {"xl", "sample sample, skinning_weights_shape: weights for 7 vertices and 3 joints, but there are 6 and 3"},
        {"text", "line 11: weights vertex 6 of the 6 in "},
        {"pt", "sample sample, mesh_skins_index: its shape is [7, 3], expected [6, any]"}},
       "",
       0,
       0,
       false},
      {"nan_weight",
       [](RigFile& rig) { rig.skin[0] = std::nanf(""); },
       {{"npz", "skin: a weight is not finite"},
        {"xl", "sample sample, skinning_weights_value[0]: a weight is not finite"},
        {"text", "line 5: \"nan\" is not finite"},
        {"pt", "sample sample, mesh_skins_index[0]: a weight is not finite"}},
       "",
       0,
       0,
       false},
      {"no_skin",
       [](RigFile& rig) { rig.has_skin = false; },
       {},
       "no skin weights: skin metrics are not computed",
       3,
       4,
       false},
      {"mesh_without_faces",
       [](RigFile& rig) {
         rig.faces.clear();
         rig.has_skin = false;
       },
       {},
       "no faces: the mesh is a point set",
       3,
       0,
       false},
      {"face_beyond_vertices",
       [](RigFile& rig) { rig.faces[4] = 6; },
       {{"npz", "faces[1]: names vertex 6 of 6"},
        {"xl", "sample sample, faces[1]: names vertex 6 of 6"},
        {"text", "line 8: vertex 7 does not exist: the file has 6"},
        {"pt", "sample sample, mesh_face[1]: names vertex 6 of 6"}},
       "",
       0,
       0,
       false},
      {"cycle",
       [](RigFile& rig) {
         rig.parents = {1, 2, 0};
       },
       {{"npz", "joint 0: is its own ancestor: the skeleton has a cycle"},
        {"xl", "sample sample, joint 0: is its own ancestor: the skeleton has a cycle"},
        {"text", "joint 0: is its own ancestor: the skeleton has a cycle"},
        {"pt", "sample sample, joint 0: is its own ancestor: the skeleton has a cycle"}},
       "",
       0,
       0,
       false}};
  return all;
}

class BadInput : public testing::TestWithParam<Case> {};

TEST_P(BadInput, GivesADefinedShapeOrAnErrorThatNamesThePlace) {
  const Case& c = GetParam();
  for (const auto& [format, writer] : formats()) {
    SCOPED_TRACE(format);
    const test::TemporaryFolder folder;
    RigFile rig;
    if (format == "pt") {  // its weights are per bone, of which there are two
      for (std::size_t v = 0; v < 6; ++v) rig.skin[3 * v] += rig.skin[3 * v + 2], rig.skin[3 * v + 2] = 0;
    }
    c.damage(rig);
    const fs::path file = folder / writer.first;
    writer.second(file, rig);
    RiggedShape shape;
    std::string refused;
    try {
      shape = open_source(file)->read("sample");
    } catch (const InputError& error) {
      EXPECT_EQ(error.file().find(folder.path().string()), 0u) << error.what();
      refused = error.place() + (error.place().empty() ? "" : ": ") + error.problem();
    }
    const auto wanted = c.refusals.find(format);
    if (wanted != c.refusals.end()) {
      EXPECT_EQ(refused.substr(0, wanted->second.size()), wanted->second) << refused;
      EXPECT_FALSE(refused.empty());
      continue;
    }
    ASSERT_EQ(refused, "");
    EXPECT_EQ(shape.joints.size(), c.joints);
    EXPECT_EQ(shape.mesh.faces.size(), c.faces);
    EXPECT_EQ(shape.has_skin(), c.has_skin);
    if (!c.note.empty()) {
      EXPECT_NE(std::find(shape.notes.begin(), shape.notes.end(), c.note), shape.notes.end())
          << testing::PrintToString(shape.notes);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Table, BadInput, testing::ValuesIn(cases()),
                         [](const auto& info) { return std::string(info.param.name); });

struct BadFile {
  const char* file;
  std::string content, refusal;
};

TEST(BadInputFile, IsRefusedWithItsReason) {
  const std::string pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12\n";
  const std::string is_pointer = "is a Git LFS pointer, not the file itself; fetch it with: git lfs pull";
  const std::vector<BadFile> files = {
      {"a.glb", pointer, is_pointer},
      {"a.npz", pointer, is_pointer},
      {"a.pt", pointer, is_pointer},
      {"a.txt", pointer, is_pointer},
      {"b.glb", "", "byte 0: the file is empty"},
      {"b.npz", "", "byte 0: the file is empty"},
      {"c.blend", "x", "not supported: rigs in .blend files; convert them to .glb"},
      {"d.csv", "pred,gt\n", "a CSV of pairs names both sides at once"},
      {"missing.glb", "", "there is no such file or folder"},
      {"e.txt", "joints a 0 0\n", "line 1: the line ends where a number should be"},
      {"f.txt", "joints a 0 0 0\njoints a 0 0 1\nroot a\n", "line 2: the joint a is given twice"},
      {"g.txt", "joints a 0 0 0\nhier a b\nroot a\n", "line 2: there is no joint \"b\""},
      {"h.txt", "joints a 0 0 0\n", "there is no root line"},
      {"i.txt", "joints a 0 0 0\nroot a\nroot a\n", "line 3: there is a second root line"},
      {"j.txt", "joints a 0 0 0\njoints b 0 0 0\nhier a b\nroot b\n", "the root b has the parent a"},
      {"k.txt", "joints a 0 0 0\nroot a\nskin 0 a 1\nskin 0 a 1\n", "line 4: vertex 0 is weighted twice"},
      {"l.txt", "joints a 0 0 0\nroot a\nskin 0.5 a 1\n", "line 3: a vertex number is whole and not negative"},
      {"m.txt", "joints a 0 0 0\nroot a\nbones a\n", "line 3: \"bones\" is none of joints, root, hier, skin"},
      {"n.txt", "joints a 0 0 0 1\nroot a\n", "line 1: \"1\" after the end of the line's content"},
      {"o.txt", "joints a 0 0 0\nroot a\nskin 0 a\n", "line 3: the line ends where a number should be"},
      {"p.txt", "# a note\n\njoints a 0 0 x\n", "line 3: \"x\" is not a number"}};
  const test::TemporaryFolder folder;
  for (const BadFile& bad : files) {
    const fs::path path = folder / bad.file;
    if (std::string(bad.file) != "missing.glb") test::write_quickly(path, bad.content);
    EXPECT_EQ(test::refusal([&] {
                const auto source = open_source(path);
                source->read(source->ids().front());
              }),
              bad.refusal)
        << bad.file;
  }
}

TEST(BadInputFile, TruncatedAndDamagedFilesOnlyThrowErrors) {
  const test::TemporaryFolder folder;
  const auto read_all = [](const fs::path& path) {
    const auto source = open_source(path);
    for (const std::string& id : source->ids()) source->read(id);
  };
  for (const auto& [format, writer] : formats()) {
    SCOPED_TRACE(format);
    const fs::path file = folder / writer.first;
    writer.second(file, RigFile());
    std::ifstream in(file, std::ios::binary);
    const std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
    EXPECT_GT(test::read_damaged(bytes, writer.first, read_all, 100), 20);
  }
}

}  // namespace

namespace {

namespace fs = std::filesystem;
using test::RigFile;
using Ids = std::vector<std::string>;

class OpenSource : public testing::Test {
 protected:
  fs::path path(const std::string& name) const {
    const fs::path full = folder_.path() / name;
    fs::create_directories(full.parent_path());
    return full;
  }
  Ids ids(const std::string& folder) const { return open_source(folder_.path() / folder)->ids(); }
  std::string problem(const std::string& folder) const {
    return test::refusal([&] { open_source(folder_.path() / folder); });
  }
  test::TemporaryFolder folder_;
  const RigFile rig_;
};

TEST_F(OpenSource, FilesInFoldersAreCalledByTheirPath) {
  for (const char* name : {"a/fish/manta.glb", "a/fish/shark.glb", "a/cat.glb", "a/notes.txt"})
    test::write_quickly(path(name), "x");
  EXPECT_EQ(ids("a"), (Ids{"cat", "fish/manta", "fish/shark"}));
  EXPECT_EQ(ids("a/"), ids("a"));
  EXPECT_EQ(ids("a/fish"), (Ids{"manta", "shark"}));
}

TEST_F(OpenSource, FilesAloneInTheirFoldersAreCalledByTheFolder) {
  for (const char* name : {"a/one/result.glb", "a/two/result.glb", "a/deep/three/x.gltf", "a/one/texture.png"})
    test::write_quickly(path(name), "x");
  EXPECT_EQ(ids("a"), (Ids{"deep/three", "one", "two"}));
  EXPECT_EQ(open_source(path("a"))->other_names("deep/three"), Ids{"x"});
  test::write_quickly(path("a/two/second.glb"), "x");  // now one folder has two
  EXPECT_EQ(ids("a"), (Ids{"deep/three/x", "one/result", "two/result", "two/second"}));
}

TEST_F(OpenSource, RawDataHidesOtherArraysBesideIt) {
  for (const char* name : {"a/rignet/7/raw_data.npz", "a/rignet/8/raw_data.npz"}) test::write_rig_npz(path(name), rig_);
  test::write_quickly(path("a/rignet/7/predict_skin.npz"), "x");
  EXPECT_EQ(ids("a"), (Ids{"rignet/7", "rignet/8"}));
  EXPECT_TRUE(open_source(path("a"))->read("rignet/8").has_skin());
  EXPECT_EQ(open_source(path("a"))->describe(), "2 NPZ rigs in " + path("a").string());
}

TEST_F(OpenSource, GeneratedAssetsHideTheirCompanions) {
  for (const char* name : {"a/cat/mesh.glb", "a/cat/skeleton.glb", "a/cat/generation.json", "a/dog/mesh.glb",
                           "a/dog/generation.json", "a/dog/dense.glb", "a/dog/latents.npz", "a/half/skeleton.glb"})
    test::write_quickly(path(name), "x");
  EXPECT_EQ(ids("a"), (Ids{"cat", "dog"}));
  EXPECT_EQ(ids("a/cat"), Ids{"mesh"});
}

TEST_F(OpenSource, TextRigsAreToldFromOtherText) {
  test::write_text_rig(path("a/7.txt"), rig_);
  test::write_quickly(path("a/train_final.txt"), "7\n8\n");
  EXPECT_EQ(ids("a"), Ids{"7"});
  EXPECT_EQ(open_source(path("a"))->read("7").mesh.faces.size(), 4u);
}

TEST_F(OpenSource, ShardsOfSamplesAreOneSource) {
  RigFile second;
  second.uuid = "second";
  test::write_anymate(path("a/train_0.pt"), {rig_});
  test::write_anymate(path("a/train_1.pt"), {second});
  EXPECT_EQ(ids("a"), (Ids{"sample", "second"}));
  test::write_anymate(path("a/train_2.pt"), {second});
  EXPECT_EQ(problem("a"), "sample 0: the name second is also that of sample 0 in " + path("a/train_1.pt").string());
}

// Results must not replace what a shape is read with.
TEST_F(OpenSource, ShapesKnowTheirFiles) {
  const auto files = [&](const std::string& folder, const std::string& id) {
    std::set<fs::path> found;
    for (const fs::path& file : open_meshes(folder_.path() / folder)->files(id)) found.insert(file);
    return found;
  };
  test::write_quickly(path("gltf/fish.gltf"), R"({"asset": {"version": "2.0"}, "buffers": [{"uri": "fish%201.bin"}],
    "images": [{"uri": "maps/fish.png"}, {"uri": "data:image/png;base64,AAAA"}]})");
  EXPECT_EQ(files("gltf", "fish"),
            (std::set<fs::path>{path("gltf/fish.gltf"), path("gltf/fish 1.bin"), path("gltf/maps/fish.png")}));
  test::write_quickly(path("gltf/broken.gltf"), "{");
  EXPECT_EQ(files("gltf", "broken"), (std::set<fs::path>{path("gltf/broken.gltf")}));

  test::write_quickly(path("obj/fish.obj"), "mtllib fish.mtl\n" + test::obj_text(rig_));
  test::write_quickly(path("obj/fish.mtl"), "newmtl skin\nmap_Kd maps\\big fish.png\n");
  const std::set<fs::path> of_obj = files("obj", "fish");
  for (const char* name : {"obj/fish.obj", "obj/fish.mtl", "obj/big fish.png", "obj/textures/big fish.png"})
    EXPECT_EQ(of_obj.count(path(name)), 1u) << name;
  test::write_quickly(path("dae/fish.dae"), "<init_from>fish.png</init_from>");
  EXPECT_EQ(files("dae", "fish").count(path("dae/fish.png")), 1u);

  test::write_rig_npz(path("data/skeleton/a/skeleton_voxelized.npz"), rig_);
  test::write_quickly(path("data/metadata.csv"), "sha256\na\n");
  EXPECT_EQ(files("data", "a").count(path("data/assets/a.glb")), 1u) << "the asset itself";
}

TEST_F(OpenSource, RefusesWhatItCannotTell) {
  fs::create_directories(path("empty/x"));
  EXPECT_EQ(problem("empty").substr(0, 35), "holds nothing that can be read: no ");
  test::write_quickly(path("a/x.glb"), "x");
  test::write_quickly(path("a/y.npz"), "x");
  EXPECT_EQ(open_source(path("a"))->ids(), (Ids{"x", "y"})) << "damage shows when they are read";
  test::write_quickly(path("b/x.glb"), "x");
  test::write_quickly(path("b/x.gltf"), "x");
  EXPECT_EQ(problem("b"), "its id \"x\" is also that of " + path("b/x.glb").string() + "; keep one of them");
  EXPECT_EQ(test::refusal([&] { open_source(path("a/x.glb"))->read("z"); }), "there is no \"z\"");
}

TEST_F(OpenSource, RealAssetsAreAllReadOrRefusedByName) {
  const fs::path assets = test::assets_dir() / "rigged" / "hand";
  if (!fs::exists(assets)) {
    GTEST_SKIP() << assets << " is missing";
  }
  const auto source = open_source(assets);
  ASSERT_FALSE(source->ids().empty());
  for (const std::string& id : source->ids()) {
    const RiggedShape shape = source->read(id);
    EXPECT_TRUE(shape.has_surface() && shape.has_joints() && shape.has_skin()) << id;
  }
}

TEST_F(OpenSource, MeshesNeedNoRig) {
  test::write_quickly(path("m/deep/body.obj"), test::obj_text(rig_));
  Mesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 2, 0}};
  mesh.faces = {{0, 1, 2}};
  write_ply(path("m/flat.ply"), mesh);
  const auto source = open_meshes(folder_.path() / "m");
  EXPECT_EQ(source->ids(), (Ids{"deep/body", "flat"}));
  const RiggedShape obj = source->read("deep/body"), ply = source->read("flat");
  EXPECT_TRUE(obj.has_surface() && ply.has_surface());
  EXPECT_FALSE(obj.has_joints() || ply.has_joints());
  EXPECT_EQ(ply.mesh.vertices[2], Eigen::Vector3f(0, 2, 0)) << "Z up";
  const Mesh as_in_file = read_obj(path("m/deep/body.obj"));
  const Eigen::Vector3f& first = as_in_file.vertices[0];
  EXPECT_EQ(obj.mesh.vertices[0], Eigen::Vector3f(first.x(), -first.z(), first.y())) << "Y up";
  EXPECT_TRUE(open_meshes(path("m/flat.ply"))->is_single_file());
  EXPECT_EQ(open_meshes(path("m/flat.ply"), {Axes::kYUp})->read("flat").mesh.vertices[2], Eigen::Vector3f(0, 0, 2));

  test::write_quickly(path("m/block.stl"),
                      "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0 3\nendloop\n"
                      "endfacet\nendsolid\n");
  EXPECT_EQ(open_meshes(path("m/block.stl"))->read("block").mesh.vertices[2], Eigen::Vector3f(0, 0, 3)) << "Z up";

  // Scenes need no skin here, and still do for those who want rigs.
  Asset bare;
  bare.mesh = mesh;
  ExportOptions without_rig;
  without_rig.require_rig = false;
  write_gltf(path("bare.glb"), bare, without_rig);
  const RiggedShape scene = open_meshes(path("bare.glb"))->read("bare");
  EXPECT_EQ(scene.mesh.vertices, mesh.vertices);
  EXPECT_FALSE(scene.has_joints());
  EXPECT_NE(test::refusal([&] { open_source(path("bare.glb"))->read("bare"); }).find("no skin"), std::string::npos);

  test::write_quickly(path("mixed/a.glb"), "x");
  test::write_quickly(path("mixed/a.obj"), "x");
  EXPECT_EQ(open_meshes(folder_.path() / "mixed")->ids(), Ids{"a"}) << "rigs go first, as open_source has them";
  EXPECT_THROW(open_meshes(path("m/none.obj"))->read("none"), InputError);
  test::write_quickly(path("m/empty.ply"), "");
  EXPECT_THROW(open_meshes(path("m/empty.ply"))->read("empty"), InputError);
}

TEST(Axes, WordsAndTurns) {
  for (const char* word : {"format", "y-up", "z-up"}) EXPECT_STREQ(name_of(parse_axes(word)), word);
  EXPECT_EQ(test::refusal([] { parse_axes("up"); }), "axes: \"up\" is none of format, y-up, z-up");
  RiggedShape shape;
  shape.joints.positions = {{1, 2, 3}};
  from_y_up(shape);
  EXPECT_EQ(shape.joints.positions[0], Eigen::Vector3d(1, -3, 2));
  to_y_up(shape);
  EXPECT_EQ(shape.joints.positions[0], Eigen::Vector3d(1, 2, 3));
}

}  // namespace

}  // namespace anigen::io
