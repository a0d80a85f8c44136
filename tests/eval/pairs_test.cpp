#include <gtest/gtest.h>

#include "anigen/core/files.h"
#include "anigen/eval/pairs.h"
#include "anigen/eval/pairs_csv.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "tests/io/arrays/array_file_bytes.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::eval {

namespace {

TEST(GroundTruth, AgreesWithTheGeneralReaderOfDataSets) {
  const test::TemporaryFolder folder;
  test::RigFile rig;
  rig.skin[0] = 0;  // a vertex without weights
  rig.skin[1] = 0;
  rig.skin[9] = 3;  // and one whose weights do not sum to 1
  test::write_rig_npz(folder / "skeleton" / "sample" / "skeleton_voxelized.npz", rig);
  write_file_atomically(folder / "metadata.csv", "sha256\nsample\n");
  const io::RiggedShape shape = io::open_source(folder.path())->read("sample");
  const GroundTruth truth = read_ground_truth(folder.path(), "sample");
  EXPECT_EQ(to_dense(shape.skin, 3), truth.skin);
  EXPECT_EQ(shape.mesh.vertices, truth.vertices);
  EXPECT_EQ(shape.mesh.faces, truth.faces);
  EXPECT_EQ(shape.joints.parents, truth.parents);
}

TEST(GroundTruth, RefusesBrokenTreesByJoint) {
  const test::TemporaryFolder folder;
  test::RigFile rig;
  rig.parents = {-1, 2, 1};
  test::write_rig_npz(folder / "skeleton" / "sample" / "skeleton_voxelized.npz", rig);
  EXPECT_EQ(test::refusal([&] { read_ground_truth(folder.path(), "sample"); }),
            "joint 1: is its own ancestor: the skeleton has a cycle");
}

}  // namespace

namespace {

namespace fs = std::filesystem;
using Ids = std::vector<std::string>;

/// A source of names only.
class Names : public io::ShapeSource {
 public:
  explicit Names(Ids ids, std::map<std::string, Ids> others = {}, bool single = false)
      : ids_(std::move(ids)), others_(std::move(others)), single_(single) {}
  Ids ids() const override { return ids_; }
  io::RiggedShape read(const std::string&) const override { return {}; }
  std::string describe() const override { return "names"; }
  Ids other_names(const std::string& id) const override {
    const auto found = others_.find(id);
    return found == others_.end() ? Ids{} : found->second;
  }
  bool is_single_file() const override { return single_; }

 private:
  Ids ids_;
  std::map<std::string, Ids> others_;
  bool single_;
};

/// "truth>prediction" or "truth: reason" for every row.
Ids rows(const PairList& list) {
  Ids told;
  for (const PairPlan& plan : list.pairs) {
    EXPECT_EQ(plan.prediction_id.has_value(), plan.missing_reason.empty());
    told.push_back(plan.prediction_id ? plan.truth_id + ">" + *plan.prediction_id
                                      : plan.truth_id + ": " + plan.missing_reason);
  }
  return told;
}

PairList match(const Names& truth, const Names& prediction) { return match_pairs(truth, prediction, truth.ids()); }

TEST(MatchPairs, EqualIdsFirstThenNamesThenARowWithItsReason) {
  const PairList list = match(Names({"fish/manta", "cat", "lost"}), Names({"cat", "out/manta", "extra", "other/cat"}));
  EXPECT_EQ(rows(list), (Ids{"fish/manta>out/manta", "cat>cat", "lost: no prediction in names"}));
  EXPECT_EQ(list.unused, (Ids{"extra", "other/cat"}));
}

TEST(MatchPairs, OtherNamesFindIdsThatAreHashes) {
  const Names truth({"0a1b", "2c3d"}, {{"0a1b", {"raw/cat.glb", "cat"}}, {"2c3d", {"raw/dog.glb", "dog"}}});
  const PairList list = match(truth, Names({"dog", "pred/cat"}));
  EXPECT_EQ(rows(list), (Ids{"0a1b>pred/cat", "2c3d>dog"}));
  EXPECT_TRUE(list.unused.empty());
}

TEST(MatchPairs, AmbiguousNamesAreRefusedWithTheCandidates) {
  const auto problem = [](const Names& truth, const Names& prediction) {
    return test::refusal([&] { match(truth, prediction); });
  };
  const std::string remedy = "; keep one of them, or name the pairs in a CSV (--pred pairs.csv)";
  EXPECT_EQ(problem(Names({"a"}), Names({"x/a", "y/a"})),
            "several predictions could be meant for a: x/a, y/a" + remedy);
  EXPECT_EQ(problem(Names({"x/a", "y/a"}), Names({"a"})),
            "the prediction a could be meant for several: x/a, y/a" + remedy);
  EXPECT_EQ(problem(Names({"a"}), Names({"1/a", "2/a", "3/a", "4/a", "5/a"})),
            "several predictions could be meant for a: 1/a, 2/a, 3/a and 2 more" + remedy);
  EXPECT_EQ(problem(Names({"u"}), Names({"u/skeleton", "u/skin"})),
            "several predictions could be meant for u: u/skeleton, u/skin" + remedy);
}

TEST(MatchPairs, LongerPathsDecideBetweenEqualNames) {
  const PairList list = match(Names({"fish/a", "cat/a"}), Names({"out/cat/a", "out/fish/a"}));
  EXPECT_EQ(rows(list), (Ids{"fish/a>out/fish/a", "cat/a>out/cat/a"}));
}

TEST(MatchPairs, WhatAnotherTruthHasIsNotGivenAway) {
  // x/a is that of the truth of this id; so "a" alone says nothing about z/a.
  const PairList list = match(Names({"x/a", "y/a"}), Names({"x/a", "z/a"}));
  EXPECT_EQ(rows(list), (Ids{"x/a>x/a", "y/a: no prediction in names: x/a has its name, and is that of x/a"}));
  EXPECT_EQ(list.unused, Ids{"z/a"});
}

TEST(MatchPairs, FilesInTheFolderOfATruthAreItsOwn) {
  EXPECT_EQ(rows(match(Names({"u", "v"}), Names({"out/u/skinned", "out/w/skinned"}))),
            (Ids{"u>out/u/skinned", "v: no prediction in names"}));
}

TEST(MatchPairs, TwoSingleFilesAreAPairWhateverTheirNames) {
  EXPECT_EQ(rows(match(Names({"truth"}, {}, true), Names({"result"}, {}, true))), Ids{"truth>result"});
  EXPECT_EQ(rows(match(Names({"truth"}), Names({"result"}, {}, true))), Ids{"truth: no prediction in names"});
}

TEST(MatchPairs, OnlyTheTruthsAskedFor) {
  const PairList list = match_pairs(Names({"a", "b"}), Names({"a", "b"}), {"b"});
  EXPECT_EQ(rows(list), Ids{"b>b"});
  EXPECT_EQ(list.unused, Ids{"a"});
}

/// An Articulation-XL shard, the dataset that preparing made of it, and predictions by three programs.
class ShardPairs : public testing::Test {
 protected:
  ShardPairs() {
    std::string table = "sha256,file_identifier,local_path,uuid,variant_of\n";
    for (int i = 0; i < 3; ++i) {
      test::RigFile rig;
      rig.uuid = "uuid-" + std::to_string(i);
      rig.joints[4] += i;
      rigs_.push_back(rig);
    }
    test::write_articulation_xl(folder_ / "xl.npz", rigs_);
    const auto shard = io::open_source(folder_ / "xl.npz", {io::Axes::kFormat, true});
    for (const test::RigFile& rig : rigs_) {
      const std::string sha = shard->sample_id(rig.uuid), name = "xl.npz#" + rig.uuid;
      shas_.push_back(sha);
      table += sha + ",in/" + name + "," + name + "," + rig.uuid + ",\n" + "pose" + sha + ",in/" + name + "," + name +
               "," + rig.uuid + "," + sha + "\n";
      test::write_rig_npz(folder_ / "data" / "skeleton" / sha / "skeleton_voxelized.npz", rig);
      test::write_glb(folder_ / "ours" / (sha + ".glb"), rig);
      test::write_glb(folder_ / "unirig" / (rig.uuid + ".glb"), rig);
      test::write_text_rig(folder_ / "puppeteer" / (rig.uuid + ".txt"), rig);
      test::write_glb(folder_ / "generated" / rig.uuid / "mesh.glb", rig);
      test::write_rig_npz(folder_ / "raw" / "xl" / rig.uuid / "raw_data.npz", rig);
      test::write_glb(folder_ / "named" / ("xl.npz#" + rig.uuid + ".glb"), rig);
    }
    test::write_quickly(folder_ / "data" / "metadata.csv", table);
  }

  /// Number of truths that find their own prediction.
  std::size_t paired(const std::string& truth, const std::string& prediction) {
    const auto gt = io::open_source(folder_ / truth, {io::Axes::kFormat, true});
    const auto pred = io::open_source(folder_ / prediction);
    test::write_quickly(folder_ / "split.txt", "uuid-0\nxl.npz#uuid-1\n" + shas_[2] + "\n");
    const PairList list = match_pairs(*gt, *pred, io::select_ids(*gt, {folder_ / "split.txt"}));
    EXPECT_EQ(list.pairs.size(), 3u);
    std::size_t count = 0;
    for (const PairPlan& plan : list.pairs) {
      if (!plan.prediction_id) continue;
      const auto number = [&](const std::string& id) {
        for (std::size_t i = 0; i < shas_.size(); ++i) {
          if (id.find(shas_[i]) != std::string::npos || id.find(rigs_[i].uuid) != std::string::npos) return i;
        }
        return shas_.size();
      };
      count += number(plan.truth_id) == number(*plan.prediction_id);
    }
    return count;
  }

  test::TemporaryFolder folder_;
  std::vector<test::RigFile> rigs_;
  Ids shas_;
};

TEST_F(ShardPairs, EveryNameOfAnAssetFindsItInTheDatasetAndInTheShard) {
  for (const char* truth : {"data", "xl.npz"}) {
    for (const char* prediction : {"ours", "unirig", "puppeteer", "generated", "raw", "named", "xl.npz", "data"})
      EXPECT_EQ(paired(truth, prediction), 3u) << truth << " with " << prediction;
  }
}

TEST_F(ShardPairs, AUuidInTwoShardsIsRefusedWithBoth) {
  test::write_quickly(
      folder_ / "data" / "metadata.csv",
      "sha256,local_path,uuid\n" + shas_[0] + ",a.npz#uuid-0,uuid-0\n" + shas_[1] + ",b.npz#uuid-0,uuid-0\n");
  const auto gt = io::open_source(folder_ / "data"), pred = io::open_source(folder_ / "unirig");
  const std::string problem = test::refusal([&] { match_pairs(*gt, *pred, gt->ids()); });
  EXPECT_NE(problem.find("uuid-0"), std::string::npos);
  EXPECT_NE(problem.find(shas_[0]), std::string::npos) << problem;
  EXPECT_NE(problem.find(shas_[1]), std::string::npos) << problem;
}

class PairsCsv : public testing::Test {
 protected:
  PairedSources read(const std::string& text) {
    test::write_quickly(folder_ / "pairs.csv", text);
    return read_pairs_csv(folder_ / "pairs.csv");
  }
  std::string problem(const std::string& text) {
    return test::refusal([&] { read(text); });
  }
  test::TemporaryFolder folder_;
};

TEST_F(PairsCsv, PathsAreRelativeToTheCsvAndNothingIsDropped) {
  const test::RigFile rig;
  fs::create_directories(folder_ / "gt");
  test::write_glb(folder_ / "gt" / "cat.glb", rig);
  test::write_text_rig(folder_ / "pred" / "x.txt", rig);
  const PairedSources sources =
      read("pred,gt,id\npred/x.txt,gt/cat.glb,\nnone.glb,gt/cat.glb,two\n,gt/lost.glb,three\n");
  EXPECT_EQ(rows(sources.list),
            (Ids{"cat>cat", "two: no prediction: " + (folder_ / "none.glb").string() + " is missing",
                 "three: the CSV names no prediction"}));
  EXPECT_EQ(sources.truth->read("cat").joints.size(), 3u);
  EXPECT_EQ(sources.prediction->read("cat").id, "cat");
  EXPECT_EQ(sources.truth->read("two").id, "two");
  EXPECT_EQ(test::refusal([&] { sources.truth->read("three"); }), "there is no such file");
}

TEST_F(PairsCsv, SaysWhatIsWrong) {
  EXPECT_EQ(problem("pred,truth\na,b\n"), "line 1: no column \"gt\": the header is pred,gt[,id]");
  EXPECT_EQ(problem("pred,gt\n"), "lists no pair");
  EXPECT_EQ(problem("pred,gt\na.glb,\n"), "row 1: names no gt");
  EXPECT_EQ(problem("pred,gt\na.glb,x/a.glb\nb.glb,y/a.glb\n"),
            "row 2: the id a appears twice; give each row one in a column id");
}

}  // namespace

}  // namespace anigen::eval
