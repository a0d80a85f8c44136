#include "anigen/eval/skin_evaluation.h"

#include <gtest/gtest.h>

#include <new>
#include <stdexcept>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/table.h"
#include "anigen/io/arrays/npz.h"
#include "tests/support/paths.h"

namespace anigen::eval {
namespace {

namespace fs = std::filesystem;

/// A dataset of three two-joint assets: "a" and "b" usable, "c" not; and predictions for "a" (half right) and "b"
/// (of a wrong shape).
class SkinEvaluationTest : public testing::Test {
 protected:
  SkinEvaluationTest() {
    write_file_atomically(
        root() / "metadata.csv",
        "sha256,local_path,source,is_bad_skeleton\na,\"x, y.glb\",real,False\nb,b.glb,real,False\nc,c.glb,real,True\n");
    for (const char* id : {"a", "b", "c"}) {
      io::write_npz(root() / "skeleton" / id / "skeleton_voxelized.npz",
                    {{"joints", io::NdArray::from(std::vector<float>{0, 0, 0, 0, 0, 0.5f}, {2, 3})},
                     {"parents", io::NdArray::from(std::vector<std::int32_t>{-1, 0}, {2})},
                     {"skin", io::NdArray::from(std::vector<float>{2, 0, 0, 0, 0, 3}, {3, 2})},
                     {"vertices", io::NdArray::from(std::vector<float>{0, 0, 0, 0, 1, 0, 1, 0, 0.6f}, {3, 3})},
                     {"faces", io::NdArray::from(std::vector<std::int32_t>{0, 1, 2}, {1, 3})}});
    }
    io::write_npz(folder_ / "pred" / "a.npz",
                  {{"skin", io::NdArray::from(std::vector<float>{1, 0, 1, 0, 1, 0}, {3, 2})}});
    io::write_npz(folder_ / "pred" / "b.npz", {{"skin", io::NdArray::from(std::vector<float>{1, 0, 1, 0}, {2, 2})}});
  }

  fs::path root() const { return folder_ / "data"; }

  SkinEvaluation evaluate() {
    std::vector<SkinMethod> methods = skin_baselines();
    methods.insert(methods.begin(), predictions_from_folder(folder_ / "pred", root(), io::list_dataset(root())));
    return evaluate_skin(root(), io::list_dataset(root()), methods);
  }

  test::TemporaryFolder folder_;
};

TEST_F(SkinEvaluationTest, GroundTruthRowsAreRepairedAsTrainingDoes) {
  EXPECT_EQ(read_ground_truth(root(), "a").skin, (std::vector<float>{1, 0, 1, 0, 0, 1}));
}

// Whoever reads a score must know that part of its ground truth was made up.
TEST_F(SkinEvaluationTest, VerticesWithoutWeightsInTheGroundTruthAreCounted) {
  const fs::path file = root() / "skeleton" / "a" / "skeleton_voxelized.npz";
  io::NamedArrays arrays = io::read_npz(file);
  for (auto& [name, array] : arrays) {
    if (name == "skin") array = io::NdArray::from(std::vector<float>{0, 0, 0, 0, 0, 1}, {3, 2});
  }
  io::write_npz(file, arrays);
  const SkinEvaluation evaluation = evaluate();
  EXPECT_EQ(evaluation.assets[0].unweighted, 2u);
  const Json json = to_json(evaluation);
  EXPECT_EQ(json["assets"][0]["unweighted_vertices"], 2);
}

TEST_F(SkinEvaluationTest, AMethodThatRunsOutOfMemoryOrIsInterrupted) {
  std::vector<SkinMethod> methods = skin_baselines();
  methods[0].parallel = false;
  methods[0].predict = [](const io::DatasetItem& item, const GroundTruth&) -> std::vector<float> {
    if (item.id == "a") throw std::bad_alloc();
    throw std::runtime_error("shapes differ\nException raised from f at x.cpp:1\nframe #0");
  };
  const SkinEvaluation evaluation = evaluate_skin(root(), io::list_dataset(root()), methods);
  EXPECT_EQ(evaluation.assets[0].methods[0].failure, "out of memory");
  EXPECT_EQ(evaluation.assets[1].methods[0].failure, "shapes differ");
  methods[0].predict = [](const io::DatasetItem&, const GroundTruth&) -> std::vector<float> {
    throw Interrupted("stopped");
  };
  EXPECT_THROW(evaluate_skin(root(), io::list_dataset(root()), methods), Interrupted);
}

TEST_F(SkinEvaluationTest, ScoresPredictionsAndKeepsFailuresApart) {
  const SkinEvaluation evaluation = evaluate();
  // Two of three vertices of "a" are right, the third is entirely wrong.
  EXPECT_NEAR(evaluation.assets[0].methods[0].scores.mean.l1, 2.0 / 3, 1e-6);
  EXPECT_NE(evaluation.assets[1].methods[0].failure.find("expected shape [3, 2]"), std::string::npos);
  EXPECT_NE(evaluation.assets[2].methods[0].failure.find("no prediction in 2 NPZ files"), std::string::npos);
  const auto usable = summarize(evaluation, 0, Group::kUsable);
  EXPECT_EQ(usable[0].n, 1u);
  EXPECT_NEAR(usable[0].mean, 2.0 / 3, 1e-6);
  EXPECT_EQ(summarize(evaluation, 1, Group::kUsable)[0].n, 2u);
  EXPECT_EQ(summarize(evaluation, 1, Group::kNotUsable)[0].n, 1u);
}

TEST_F(SkinEvaluationTest, WritesWhatReadersRelyOn) {
  const SkinEvaluation evaluation = evaluate();
  const Json json = to_json(evaluation);
  EXPECT_EQ(json["method"], "prediction");
  EXPECT_EQ(json["assets"].size(), 3u);
  EXPECT_EQ(json["assets"][0]["id"], "a");
  EXPECT_NEAR(json["assets"][0]["skin_l1"].get<double>(), 2.0 / 3, 1e-6);
  EXPECT_TRUE(json["assets"][1].contains("failure"));
  for (const char* key : {"skin_l1", "skin_l2", "skin_kl"}) {
    for (const char* part : {"mean", "median", "std", "n"})
      EXPECT_TRUE(json["summary"][key].contains(part)) << key << part;
  }
  EXPECT_EQ(json["methods"]["rank4"]["summary"]["skin_l1"]["n"], 2);
  EXPECT_TRUE(json["methods"]["rank4"]["oracle"].get<bool>());

  const CsvTable csv = parse_csv(to_csv(to_csv_table(evaluation)), "memory");
  EXPECT_EQ(csv.rows.size(), 3u * 6u);
  EXPECT_EQ(csv.cell(0, "name"), "x, y.glb");
  EXPECT_EQ(csv.cell(0, "method"), "prediction");
  const std::string markdown = to_markdown(evaluation);
  EXPECT_NE(markdown.find("c.glb"), std::string::npos) << "assets that are not usable are named";
  EXPECT_NE(markdown.find("Without scores"), std::string::npos);
}

TEST_F(SkinEvaluationTest, SplitsSelectAndRefuseUnknownIds) {
  write_file_atomically(folder_ / "split.txt", "# test\nc\n\na\r\n");
  const auto selected = select_split(io::list_dataset(root()), {folder_ / "split.txt"});
  ASSERT_EQ(selected.size(), 2u);
  EXPECT_EQ(selected[0].id, "a");
  write_file_atomically(folder_ / "split.txt", "a\nzzz\n");
  try {
    select_split(io::list_dataset(root()), {folder_ / "split.txt"});
    ADD_FAILURE() << "accepted an unknown id";
  } catch (const InputError& error) {
    EXPECT_EQ(error.place(), "line 2");
  }
}

TEST_F(SkinEvaluationTest, BrokenGroundTruthIsNamed) {
  const fs::path file = root() / "skeleton" / "a" / "skeleton_voxelized.npz";
  io::NamedArrays arrays = io::read_npz(file);
  for (auto& [name, array] : arrays) {
    if (name == "faces") array = io::NdArray::from(std::vector<std::int32_t>{0, 1, 3}, {1, 3});
  }
  io::write_npz(file, arrays);
  try {
    read_ground_truth(root(), "a");
    ADD_FAILURE() << "accepted a face out of range";
  } catch (const InputError& error) {
    EXPECT_EQ(error.place(), "faces[0]");
  }
  write_file_atomically(file, "not an archive");
  const SkinEvaluation evaluation = evaluate();
  for (const MethodResult& result : evaluation.assets[0].methods) EXPECT_FALSE(result.failure.empty());
  EXPECT_EQ(summarize(evaluation, 1, Group::kUsable)[0].n, 1u);
}

TEST_F(SkinEvaluationTest, RefusesMetadataThatNamesPathsOrRepeatsIds) {
  for (const char* ids : {"../evil", "a\na", ".."}) {
    write_file_atomically(root() / "metadata.csv", std::string("sha256\n") + ids + "\n");
    EXPECT_THROW(io::list_dataset(root()), InputError) << ids;
  }
}

TEST(Summary, MatchesHandComputedValues) {
  const Summary four = summarize(std::vector<double>{4, 1, 3, 2});
  EXPECT_DOUBLE_EQ(four.mean, 2.5);
  EXPECT_DOUBLE_EQ(four.median, 2.5);
  EXPECT_NEAR(four.std, 1.1180339887, 1e-9);
  EXPECT_DOUBLE_EQ(summarize(std::vector<double>{5, 1, 2}).median, 2);
  EXPECT_EQ(summarize(std::vector<double>{}).n, 0u);
}

TEST(Tables, MarkdownEscapesAndAligns) {
  EXPECT_EQ(to_markdown(anigen::Table{{"name", "x", "note"}, {{"a|b", "–", "why"}, {"c", "1.25", ""}}}),
            "| name |    x | note |\n| ---- | ---: | ---- |\n| a\\|b |    – | why  |\n| c    | 1.25 |      |\n");
  EXPECT_EQ(html_escaped("<a & \"b\">"), "&lt;a &amp; &quot;b&quot;&gt;");
}

TEST_F(SkinEvaluationTest, PredictionsAndSplitsMayUseAnyNameOfAnAsset) {
  write_file_atomically(root() / "metadata.csv",
                        "sha256,local_path,uuid\na,xl.npz#u-1,u-1\nb,xl.npz#u-2,u-2\nc,xl.npz#u-3,u-3\n");
  fs::rename(folder_ / "pred" / "a.npz", folder_ / "pred" / "u-1.npz");
  fs::copy_file(folder_ / "pred" / "u-1.npz", folder_ / "pred" / "stray.npz");
  write_file_atomically(folder_ / "split.txt", "u-1\nxl.npz#u-2\n");
  const auto items = select_split(io::list_dataset(root()), {folder_ / "split.txt"});
  ASSERT_EQ(items.size(), 2u);
  std::vector<std::string> unused;
  const SkinMethod method = predictions_from_folder(folder_ / "pred", root(), items, &unused);
  EXPECT_EQ(unused, std::vector<std::string>{"stray"});
  EXPECT_EQ(method.predict(items[0], read_ground_truth(root(), "a")), (std::vector<float>{1, 0, 1, 0, 1, 0}));
  fs::create_directories(folder_ / "pred" / "more");
  fs::copy_file(folder_ / "pred" / "u-1.npz", folder_ / "pred" / "more" / "u-1.npz");
  EXPECT_THROW(predictions_from_folder(folder_ / "pred", root(), items), InputError) << "two files of one name";
}

}  // namespace
}  // namespace anigen::eval
