#include <gtest/gtest.h>

#include "anigen/eval/inputs/pairs.h"
#include "tests/io/array_file_bytes.h"
#include "tests/support/rig_files.h"

namespace anigen::eval {
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

TEST(MatchPairs, AmbiguousNamesAreNotGuessed) {
  EXPECT_EQ(rows(match(Names({"a"}), Names({"x/a", "y/a"}))), Ids{"a: several predictions could be meant: x/a, y/a"});
  const PairList list = match(Names({"x/a", "y/a"}), Names({"a"}));
  EXPECT_EQ(rows(list), (Ids{"x/a: the prediction a could be meant for several: x/a, y/a",
                             "y/a: the prediction a could be meant for several: x/a, y/a"}));
  EXPECT_EQ(list.unused, Ids{"a"});
  EXPECT_EQ(rows(match(Names({"a"}), Names({"1/a", "2/a", "3/a", "4/a", "5/a"}))),
            Ids{"a: several predictions could be meant: 1/a, 2/a, 3/a and 2 more"});
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
