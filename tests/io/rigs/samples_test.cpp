#include "anigen/io/rigs/samples.h"

#include <gtest/gtest.h>

#include "anigen/io/arrays/npz.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "tests/io/arrays/array_file_bytes.h"
#include "tests/support/rig_files.h"

namespace anigen::io {
namespace {

namespace fs = std::filesystem;
using Ids = std::vector<std::string>;

class Samples : public testing::Test {
 protected:
  Samples() {
    other_.uuid = "other";
    other_.joints[4] = 7;
    test::write_articulation_xl(folder_ / "xl.npz", {rig_, other_});
  }
  std::string problem(const std::string& path) const {
    return test::refusal([&] { open_source(folder_.path() / path); });
  }
  test::TemporaryFolder folder_;
  test::RigFile rig_, other_;
};

TEST_F(Samples, OneOfAFileByNameOrByNumber) {
  for (const char* name : {"xl.npz#other", "xl.npz#1"}) {
    const auto source = open_source(folder_ / name);
    EXPECT_EQ(source->ids(), Ids{"other"});
    EXPECT_TRUE(source->is_single_file());
    EXPECT_EQ(source->read("other").joints.positions[1].y(), 7.0);
    EXPECT_EQ(test::refusal([&] { source->read("sample"); }), "has no sample \"sample\"");
    EXPECT_EQ(source->files("other"), std::vector<fs::path>{folder_ / "xl.npz"});
  }
  test::write_anymate(folder_ / "any.pt", {test::per_bone(rig_), test::per_bone(other_)});
  EXPECT_EQ(open_source(folder_ / "any.pt#1")->ids(), Ids{"other"});
  EXPECT_EQ(open_source(folder_ / "any.pt#sample")->ids(), Ids{"sample"});
}

TEST_F(Samples, NumbersOutOfRangeAndOtherNamesAreRefused) {
  EXPECT_EQ(problem("xl.npz#2"), "#2: is the number of no sample: it holds 2, counted from 0");
  EXPECT_EQ(problem("xl.npz#99999999999999999999"),
            "#99999999999999999999: is the number of no sample: it holds 2, counted from 0");
  EXPECT_EQ(problem("xl.npz#-1"), "#-1: there is no sample of this name among its 2");
  EXPECT_EQ(problem("xl.npz#"), "#: there is no sample of this name among its 2");
  EXPECT_EQ(problem("none.npz#1"), "there is no such file or folder");
}

TEST_F(Samples, NamesGoBeforeNumbers) {
  rig_.uuid = "1";
  test::write_articulation_xl(folder_ / "n.npz", {rig_, other_});
  EXPECT_EQ(open_source(folder_ / "n.npz#1")->ids(), Ids{"1"});
  EXPECT_EQ(open_source(folder_ / "n.npz#0")->ids(), Ids{"1"});
}

TEST_F(Samples, OpenShardsRemembersWhyAFileCannotBeOpened) {
  const OpenShards shards({});
  EXPECT_EQ(shards.read(folder_ / "xl.npz", "1").id, "other");
  EXPECT_EQ(shards.read(folder_ / "xl.npz", "sample").id, "sample");
  test::write_quickly(folder_ / "cut.npz", read_file(folder_ / "xl.npz", 1 << 20).substr(0, 1000));
  const auto why = [&] { return test::refusal([&] { shards.read(folder_ / "cut.npz", "0"); }); };
  const std::string first = why();
  EXPECT_NE(first.find("zip archive"), std::string::npos) << first;
  test::write_articulation_xl(folder_ / "cut.npz", {rig_});
  EXPECT_EQ(why(), first);
}

TEST_F(Samples, AFolderOfManyFormatsIsOneSource) {
  const fs::path in = folder_ / "in";
  test::write_articulation_xl(in / "xl.npz", {rig_, other_});
  test::write_glb(in / "a.glb", rig_);
  test::write_text_rig(in / "b.txt", rig_);
  test::write_rig_npz(in / "c" / "raw.npz", rig_);
  test::RigFile third = test::per_bone(rig_);
  third.uuid = "third";
  test::write_anymate(in / "any.pt", {third});
  const auto source = open_source(in);
  EXPECT_EQ(source->ids(), (Ids{"a", "b", "c/raw", "sample", "other", "third"}));
  EXPECT_NE(source->describe().find("1 rigged file, 1 NPZ rig, 1 text rig, 1 Articulation-XL file, 1 Anymate file in "),
            std::string::npos)
      << source->describe();
  for (const std::string& id : source->ids()) EXPECT_EQ(source->read(id).joints.size(), 3u) << id;
  EXPECT_EQ(source->read("other").joints.positions[1].y(), 7.0);
  EXPECT_FALSE(source->is_single_file());
}

TEST_F(Samples, TheSameAssetTwiceInAFolderIsRefusedWithBothPlaces) {
  test::write_glb(folder_ / "in" / "sample.glb", rig_);
  test::write_articulation_xl(folder_ / "in" / "xl.npz", {rig_});
  const std::string twice = problem("in");
  EXPECT_NE(twice.find("the id \"sample\" is in 1 rigged file"), std::string::npos) << twice;
  EXPECT_NE(twice.find("xl.npz"), std::string::npos) << twice;
  test::write_glb(folder_ / "two" / "x.glb", rig_);
  test::write_text_rig(folder_ / "two" / "x.txt", rig_);
  EXPECT_NE(problem("two").find("x.glb; keep one of them"), std::string::npos) << problem("two");
}

TEST_F(Samples, ADamagedShardHidesNothingElse) {
  const fs::path in = folder_ / "in";
  test::write_articulation_xl(in / "good.npz", {rig_});
  test::write_quickly(in / "cut.npz", read_file(folder_ / "xl.npz", 1 << 20).substr(0, 1000));
  const auto source = open_source(in);
  EXPECT_EQ(source->ids(), (Ids{"cut", "sample"}));
  EXPECT_EQ(source->read("sample").joints.size(), 3u);
  EXPECT_NE(test::refusal([&] { source->read("cut"); }).find("zip archive"), std::string::npos);
}

TEST_F(Samples, FilesOfTailorRigAreNotSupported) {
  write_npz(folder_ / "TailorRig_test.npz", {{"points", NdArray::from<float>({1, 2, 3}, {1, 3})}});
  try {
    open_source(folder_ / "TailorRig_test.npz");
    ADD_FAILURE() << "was read";
  } catch (const NotSupportedError& error) {
    EXPECT_NE(std::string(error.what()).find("not supported: TailorRig's files, whose layout is not published"),
              std::string::npos)
        << error.what();
  }
}

TEST_F(Samples, TextRigsWithoutAMeshKeepTheirWeights) {
  test::write_text_rig(folder_ / "in" / "x.txt", rig_);
  fs::remove(folder_ / "in" / "x.obj");
  const RiggedShape shape = open_source(folder_ / "in")->read("x");
  EXPECT_TRUE(shape.mesh.vertices.empty());
  EXPECT_EQ(shape.skin.rows(), 6u);
  EXPECT_FALSE(shape.has_skin()) << "there are no vertices that they belong to";
  EXPECT_EQ(to_asset(shape).skin.rows(), 0u);
  // A vertex number that no mesh of so few lines has.
  test::write_quickly(folder_ / "far.txt", "joints a 0 0 0\nroot a\nskin 999999999999 a 1\n");
  EXPECT_EQ(open_source(folder_ / "far.txt")->read("far").skin.rows(), 0u);
}

}  // namespace
}  // namespace anigen::io
