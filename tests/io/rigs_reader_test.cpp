#include "anigen/io/rigs/rig_reader.h"

#include <gtest/gtest.h>

#include <map>

#include "anigen/asset/validate.h"
#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"
#include "tests/support/scene_files.h"

namespace anigen::io {
namespace {

namespace fs = std::filesystem;
using test::RigFile;

class Rigs : public testing::Test {
 protected:
  /// One rig in every format, in a folder with files that are none.
  void write_all() {
    test::write_glb(folder_ / "in/a.glb", rig_);
    write_file_atomically(folder_ / "in/b.dae", test::collada_text(rig_));
    write_file_atomically(folder_ / "in/c.FBX", test::fbx_text(rig_));
    test::write_text_rig(folder_ / "in/d/d.txt", rig_);
    write_file_atomically(folder_ / "in/d/notes.txt", "notes\n");
    test::write_rig_npz(folder_ / "in/e/raw_data.npz", rig_);
    RigFile other = rig_;
    other.uuid = "other";
    other.vertices[0] = -0.2f;
    test::write_articulation_xl(folder_ / "in/f_test.npz", {rig_, other});
    test::write_anymate(folder_ / "in/g.pt", {test::per_bone(rig_)});
  }

  test::TemporaryFolder folder_;
  RigFile rig_;
};

TEST_F(Rigs, AreListedFromMixedFolders) {
  write_all();
  std::string listed;
  for (const RigEntry& entry : list_rigs(folder_ / "in"))
    listed += std::string(name_of(entry.format)) + " " + entry.local_path + (entry.is_test ? " test\n" : "\n");
  EXPECT_EQ(listed,
            "gltf a.glb\nassimp b.dae\nassimp c.FBX\ntext_rig d/d.txt\nrig_arrays e/raw_data.npz\n"
            "articulation_xl f_test.npz#sample test\narticulation_xl f_test.npz#other test\nanymate g.pt#sample\n");
  EXPECT_EQ(list_rigs(folder_ / "in/g.pt").at(0).key, "sample");
  for (const RigFormat format : {RigFormat::kGltf, RigFormat::kDataset})
    EXPECT_EQ(parse_rig_format(name_of(format)), format);
  EXPECT_THROW(parse_rig_format("obj"), InputError);
}

TEST_F(Rigs, OfEveryFormatAreReadAsAssets) {
  write_all();
  const RigReader reader;
  for (const RigEntry& entry : list_rigs(folder_ / "in")) {
    const ImportedAsset imported = reader.read(entry);
    EXPECT_TRUE(validate(imported.asset).empty()) << entry.local_path;
    EXPECT_EQ(imported.asset.skeleton.size(), 3u) << entry.local_path;
    EXPECT_EQ(imported.asset.mesh.faces.size(), 4u) << entry.local_path;
    EXPECT_EQ(imported.asset.skin.rows(), imported.asset.mesh.vertices.size()) << entry.local_path;
  }
}

TEST_F(Rigs, KeepTheirNamesWhereTheseAreUnique) {
  test::write_text_rig(folder_ / "in/d.txt", rig_);
  EXPECT_EQ(RigReader().read(list_rigs(folder_ / "in").at(0)).asset.skeleton.names,
            (std::vector<std::string>{"j0", "j1", "j2"}));
}

TEST_F(Rigs, AreCalledByTheirContentWhereverItLies) {
  RigFile other = rig_, third = rig_;
  other.uuid = "other";
  other.joints[2] = 0.125;
  third.uuid = "third";
  third.vertices[1] = 0.25f;
  test::write_articulation_xl(folder_ / "one/all.npz", {rig_, other, third});
  test::write_articulation_xl(folder_ / "two/a.npz", {other});
  test::write_articulation_xl(folder_ / "two/b.npz", {third, rig_});
  const auto ids = [](const fs::path& folder) {
    const RigReader reader;
    std::map<std::string, std::string> ids;
    for (const RigEntry& entry : list_rigs(folder)) ids[entry.key] = reader.content_id(entry);
    return ids;
  };
  const auto one = ids(folder_ / "one");
  EXPECT_EQ(one, ids(folder_ / "two"));
  EXPECT_EQ(one.at("sample").size(), 64u);
  EXPECT_NE(one.at("sample"), one.at("other"));
  EXPECT_NE(one.at("sample"), one.at("third"));

  test::write_anymate(folder_ / "three/a.pt", {test::per_bone(rig_)});
  test::write_anymate(folder_ / "four/b.pt", {test::per_bone(other), test::per_bone(rig_)});
  EXPECT_EQ(ids(folder_ / "three").at("sample"), ids(folder_ / "four").at("sample"));
  EXPECT_NE(ids(folder_ / "four").at("other"), ids(folder_ / "four").at("sample"));
}

TEST_F(Rigs, TextRigsFollowTheirMesh) {
  test::write_text_rig(folder_ / "in/a.txt", rig_);
  const RigEntry entry = list_rigs(folder_ / "in").at(0);
  const std::string before = RigReader().content_id(entry);
  rig_.vertices[0] = -0.3f;
  write_file_atomically(folder_ / "in/a.obj", test::obj_text(rig_));
  EXPECT_NE(RigReader().content_id(entry), before);
}

TEST_F(Rigs, OfDatasetsCarryTheirFlags) {
  test::write_rig_npz(folder_ / "skeleton/x/skeleton_voxelized.npz", rig_);
  test::write_rig_npz(folder_ / "skeleton/y/skeleton_voxelized.npz", rig_);
  write_file_atomically(folder_ / "metadata.csv", "sha256,local_path,is_test\nx,cat.glb,True\ny,,False\n");
  write_file_atomically(folder_ / "ignored.glb", "not looked at");
  const std::vector<RigEntry> entries = list_rigs(folder_.path());
  ASSERT_EQ(entries.size(), 2u);
  EXPECT_EQ(entries[0].key, "x");
  EXPECT_EQ(entries[0].local_path, "cat.glb");
  EXPECT_TRUE(entries[0].is_test);
  EXPECT_FALSE(entries[1].is_test);
  EXPECT_EQ(RigReader().read(entries[1]).asset.skeleton.size(), 3u);
  EXPECT_EQ(RigReader().content_id(entries[0]), RigReader().content_id(entries[1])) << "one content";
}

TEST_F(Rigs, WithMissingPartsAreNoAssets) {
  rig_.has_skin = false;
  test::write_rig_npz(folder_ / "in/a.npz", rig_);
  const auto read = [&] { RigReader().read(list_rigs(folder_ / "in").at(0)); };
  EXPECT_NE(test::refusal(read).find("has no skin weights"), std::string::npos);
  rig_.has_skin = true;
  rig_.faces.clear();
  test::write_rig_npz(folder_ / "in/a.npz", rig_);
  EXPECT_NE(test::refusal(read).find("has no mesh with faces"), std::string::npos);
}

TEST_F(Rigs, TellWhatWasMissingInTheirWeights) {
  rig_.skin[0] = 0;    // vertex 0 has none
  rig_.skin[3] = 0.5;  // vertex 1 has half
  test::write_rig_npz(folder_ / "in/a.npz", rig_);
  const ImportedAsset imported = RigReader().read(list_rigs(folder_ / "in").at(0));
  EXPECT_NEAR(imported.lowest_weight_sum, 0.5, 1e-6);
  ASSERT_FALSE(imported.notes.empty());
  EXPECT_EQ(imported.notes[0].code, "zero_weights");
  EXPECT_EQ(imported.notes[0].message.substr(0, 2), "1 ");
}

TEST_F(Rigs, RefusalsNameTheirFile) {
  EXPECT_EQ(test::refusal([&] { list_rigs(folder_ / "absent"); }), "no such file or folder");
  fs::create_directories(folder_ / "empty");
  EXPECT_NE(test::refusal([&] { list_rigs(folder_ / "empty"); }).find("holds no rigged asset"), std::string::npos);
  write_file_atomically(folder_ / "a.txt", "notes\n");
  EXPECT_NE(test::refusal([&] { list_rigs(folder_ / "a.txt"); }).find("is no text rig"), std::string::npos);
  write_file_atomically(folder_ / "a.blend", "x");
  EXPECT_NE(test::refusal([&] { list_rigs(folder_ / "a.blend"); }).find("expected a folder"), std::string::npos);
  write_file_atomically(folder_ / "bad/a.npz", "not an archive");
  EXPECT_THROW(list_rigs(folder_ / "bad/a.npz"), InputError);
  // In a folder it stands for itself, so that it fails alone and by name.
  const std::vector<RigEntry> entries = list_rigs(folder_ / "bad");
  ASSERT_EQ(entries.size(), 1u);
  EXPECT_EQ(entries[0].local_path, "a.npz");
  EXPECT_THROW(RigReader().read(entries[0]), InputError);
  EXPECT_THROW(RigReader().content_id(entries[0]), InputError);
}

}  // namespace
}  // namespace anigen::io
