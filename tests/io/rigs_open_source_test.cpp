#include <gtest/gtest.h>

#include <set>

#include "anigen/core/error.h"
#include "anigen/io/gltf.h"
#include "anigen/io/obj.h"
#include "anigen/io/ply.h"
#include "anigen/io/rigs/axes.h"
#include "anigen/io/rigs/shape_source.h"
#include "tests/io/array_file_bytes.h"
#include "tests/support/rig_files.h"

namespace anigen::io {
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
  EXPECT_EQ(problem("a"), "holds several formats (1 glTF/FBX/DAE, 1 NPZ); name a sub-folder with one of them");
  test::write_quickly(path("b/x.glb"), "x");
  test::write_quickly(path("b/x.gltf"), "x");
  EXPECT_EQ(problem("b"), "its id \"x\" is also that of " + path("b/x.glb").string() + "; keep one of them");
  EXPECT_EQ(test::refusal([&] { open_source(path("a/x.glb"))->read("z"); }), "there is no \"z\"");
}

TEST_F(OpenSource, RealAssetsAreAllReadOrRefusedByName) {
  const fs::path assets = test::assets_dir() / "rigged" / "hand";
  if (!fs::exists(assets)) GTEST_SKIP() << assets << " is missing";
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
