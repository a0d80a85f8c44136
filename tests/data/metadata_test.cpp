#include <gtest/gtest.h>
#include <cmath>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/run_folder.h"
#include "anigen/data/metadata.h"
#include "tests/support/paths.h"

namespace anigen::data {

namespace {

CsvTable table() {
  return parse_csv(
      "sha256,aesthetic_score,is_bad_skin,is_bad_skeleton,is_test,num_voxels,captions\n"
      "a,6.0,False,False,False,100,\"[\"\"x, y\"\"]\"\n"
      "b,4.0,False,False,True,100,\n"
      "c,7.0,True,False,False,40000,\n"
      "d,7.0,False,True,False,100,\n",
      "metadata.csv");
}

std::string ids(const CsvTable& rows, const RowFilter& filter) {
  std::string line;
  for (const AssetId& asset : select_rows(rows, "root", filter)) line += asset.id;
  return line;
}

std::string error_of(const CsvTable& rows, const RowFilter& filter) {
  try {
    select_rows(rows, "root", filter);
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST(RowFilter, EachFilterDropsItsRows) {
  RowFilter none;
  none.min_aesthetic_score = 0;
  none.drop_bad_skeleton = false;
  EXPECT_EQ(ids(table(), none), "abcd");
  RowFilter f = none;
  f.min_aesthetic_score = 4.5;
  EXPECT_EQ(ids(table(), f), "acd");
  f = none;
  f.drop_bad_skeleton = true;
  EXPECT_EQ(ids(table(), f), "abc");
  f = none;
  f.drop_bad_skin = true;
  EXPECT_EQ(ids(table(), f), "abd");
  f = none;
  f.max_num_voxels = 32768;
  EXPECT_EQ(ids(table(), f), "abd");
  f = none;
  f.is_test = true;
  EXPECT_EQ(ids(table(), f), "b");
  f.is_test = false;
  EXPECT_EQ(ids(table(), f), "acd");
  f = none;
  f.only = std::set<std::string>{"d", "a", "elsewhere"};
  EXPECT_EQ(ids(table(), f), "ad");
}

TEST(RowFilter, ASourceWithoutTheColumnPasses) {
  const CsvTable bare = parse_csv("sha256\nx\n", "metadata.csv");
  RowFilter all;
  all.drop_bad_skin = true;
  all.max_num_voxels = 5;
  EXPECT_EQ(ids(bare, all), "x");
  all.is_test = true;
  EXPECT_NE(error_of(bare, all).find("is_test"), std::string::npos);
}

TEST(RowFilter, AFilterThatLeavesNothingIsNamedWithCounts) {
  RowFilter strict;
  strict.min_aesthetic_score = 9;
  EXPECT_NE(error_of(table(), strict).find("min_aesthetic_score"), std::string::npos);
  EXPECT_NE(error_of(table(), strict).find("none of the 4 rows"), std::string::npos);
  RowFilter flagged;
  flagged.required_flags = {"voxelized"};
  EXPECT_NE(error_of(table(), flagged).find("voxelized"), std::string::npos);
}

TEST(RowFilter, HostileTablesAreErrors) {
  RowFilter f;
  for (const char* id : {"../../etc/passwd", "", ".hidden", "a/b", "..\\\\x"})
    EXPECT_THROW(select_rows(parse_csv("sha256,x\n" + std::string(id) + ",1\n", "m"), "root", f), InputError) << id;
  EXPECT_THROW(select_rows(parse_csv("sha256\na\na\n", "m"), "root", f), InputError) << "twice";
  EXPECT_THROW(select_rows(parse_csv("sha256,aesthetic_score\na,good\n", "m"), "root", f), InputError);
  EXPECT_THROW(select_rows(parse_csv("sha256,is_bad_skeleton\na,perhaps\n", "m"), "root", f), InputError);
  EXPECT_THROW(select_rows(parse_csv("id\na\n", "m"), "root", f), InputError) << "no sha256";
  EXPECT_THROW(select_rows(parse_csv("sha256\n", "m"), "root", f), InputError) << "no rows";
}

TEST(Split, OneIdPerLine) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "split.txt") << "# held out\na\r\n\nb\n";
  EXPECT_EQ(read_split(folder / "split.txt"), (std::set<std::string>{"a", "b"}));
  std::ofstream(folder / "empty.txt") << "# nothing\n";
  EXPECT_THROW(read_split(folder / "empty.txt"), InputError);
}

TEST(Split, NamesAssetsAsOtherProgramsDo) {
  const test::TemporaryFolder folder;
  const auto table = [&](const char* root, const std::string& rows) {
    std::filesystem::create_directories(folder / root);
    std::ofstream(folder / root / "metadata.csv") << "sha256,local_path,uuid,variant_of\n" << rows;
  };
  table("one", "a,xl.npz#u-a,u-a,\na1,xl.npz#u-a,u-a,a\n");
  table("two", "b,b.glb,,\nc,c.glb,,\n");
  std::ofstream(folder / "split.txt") << "u-a\nb.glb\nc\nelsewhere\n";
  const std::string roots = (folder / "one").string() + "," + (folder / "two").string();
  EXPECT_EQ(read_split(folder / "split.txt", roots), (std::set<std::string>{"a", "b", "c", "elsewhere"}));
  table("two", "b,b.glb,u-a,\n");
  EXPECT_THROW(read_split(folder / "split.txt", roots), InputError) << "two assets have that uuid";
}

}  // namespace

namespace {

TEST(SourceOptions, SmallerTrainingSharesArePartOfLargerOnesAndLeaveHeldOutAssetsAlone) {
  const test::TemporaryFolder folder;
  std::string table = "sha256\n", held_out;
  for (int i = 0; i < 300; ++i) {
    table += "asset" + std::to_string(i) + "\n";
    if (i % 10 == 0) held_out += "asset" + std::to_string(i) + "\n";
  }
  write_file_atomically(folder / "metadata.csv", table);
  write_file_atomically(folder / "test.txt", held_out);
  SourceOptions options;
  options.data_dir = folder.path().string();
  options.eval_split = "test.txt";
  std::set<std::string> larger;
  for (const double share : {1.0, 0.5, 0.25, 0.125}) {
    options.train_share = share;
    const TrainAndEval chosen = select(options);
    EXPECT_EQ(chosen.eval.size(), 30u);
    // Four standard deviations of a binomial choice.
    EXPECT_NEAR(static_cast<double>(chosen.train.size()), 270 * share, 4 * std::sqrt(270 * share * (1 - share)));
    std::set<std::string> ids;
    for (const AssetId& asset : chosen.train) ids.insert(asset.id);
    for (const std::string& id : ids) EXPECT_TRUE(larger.empty() || larger.count(id) > 0) << id;
    larger = ids;
  }
  options.train_share = 0;
  EXPECT_THROW(select(options), InputError);
  options.train_share = 0.5;
  options.eval_split.clear();
  options.eval_fraction = 0.2;
  const std::size_t held = select(options).eval.size();
  options.train_share = 1;
  EXPECT_EQ(select(options).eval.size(), held);
}

TEST(Select, KeepsPosedVariantsWithTheirSource) {
  const test::TemporaryFolder folder;
  std::string table = "sha256,variant_of\n";
  for (int i = 0; i < 100; ++i) {
    const std::string id = "a" + std::to_string(i);
    table += id + ",\n" + id + "x1," + id + "\n" + id + "x2," + id + "\n";
  }
  write_file_atomically(folder / "metadata.csv", table);
  SourceOptions options;
  options.data_dir = folder.path().string();
  options.eval_fraction = 0.3;
  options.train_share = 0.5;
  const TrainAndEval chosen = select(options);
  for (const std::vector<AssetId>* assets : {&chosen.train, &chosen.eval}) {
    std::map<std::string, int> poses;
    for (const AssetId& asset : *assets) ++poses[asset.id.substr(0, asset.id.find('x'))];
    EXPECT_GT(poses.size(), 10u);
    for (const auto& [id, count] : poses) EXPECT_EQ(count, 3) << id;
  }
}

TEST(Select, HoldsOutPosedVariantsWithTheirSource) {
  const test::TemporaryFolder folder;
  write_file_atomically(folder / "metadata.csv", "sha256,variant_of\na,\nb,\nbx1,b\nc,\ncx1,c\n");
  write_file_atomically(folder / "held_out.txt", "b\n");
  SourceOptions options;
  options.data_dir = folder.path().string();
  options.eval_split = "held_out.txt";
  const TrainAndEval chosen = select(options);
  std::vector<std::string> trained;
  for (const AssetId& asset : chosen.train) trained.push_back(asset.id);
  EXPECT_EQ(trained, (std::vector<std::string>{"a", "c", "cx1"}));
  ASSERT_EQ(chosen.eval.size(), 1u);
  EXPECT_EQ(chosen.eval[0].id, "b");
}

// A dataset of creatures, `rows` of "<id> <seed>/<index> <is_test>".
void write_creatures(const std::filesystem::path& root, const std::vector<std::string>& rows) {
  std::string table = "sha256,file_identifier,is_test,variant_of\n", train, test;
  for (const std::string& row : rows) {
    std::istringstream words(row);
    std::string id, creature, is_test;
    words >> id >> creature >> is_test;
    table += id + ",procedural/" + creature + "," + is_test + ",\n";
    (is_test == "True" ? test : train) += id + "\n";
  }
  write_file_atomically(root / "metadata.csv", table);
  write_file_atomically(root / "splits/train.txt", train);
  write_file_atomically(root / "splits/test.txt", test);
}

std::string refusal_of(const SourceOptions& options) {
  try {
    refuse_test_creatures(select(options), options);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(TestCreatures, AreNeverTrainedOn) {
  const test::TemporaryFolder folder;
  write_creatures(folder / "data", {"a 0/0 False", "b 0/1 True", "b2 0/1 False"});
  SourceOptions options;
  options.data_dir = (folder / "data").string();
  // Without a split the test asset itself; with one its posed variant, which some other program marked otherwise.
  EXPECT_NE(refusal_of(options).find("b: creature procedural/0/1, seed 0"), std::string::npos) << refusal_of(options);
  options.split = "splits/train.txt";
  EXPECT_NE(refusal_of(options).find("b2: creature procedural/0/1"), std::string::npos) << refusal_of(options);

  write_creatures(folder / "data", {"a 0/0 False", "b 0/1 True", "c 5/2 False", "c2 5/2 False"});
  EXPECT_EQ(refusal_of(options), "");
  // Names of test assets of another dataset: the id of a creature is the same in all of them.
  write_file_atomically(folder / "other.txt", "c\n");
  options.test_splits = {(folder / "other.txt").string()};
  EXPECT_NE(refusal_of(options).find("c: creature procedural/5/2, seed 5"), std::string::npos) << refusal_of(options);
  write_file_atomically(folder / "other.txt", "procedural/5/2\n");
  EXPECT_NE(refusal_of(options).find("c: creature procedural/5/2, seed 5"), std::string::npos) << refusal_of(options);

  options.test_splits.clear();
  write_creatures(folder / "data", {"a 0/0 False", "d 900000000/4 False"});
  EXPECT_NE(refusal_of(options).find("creature procedural/900000000/4, seed 900000000"), std::string::npos);
  write_creatures(folder / "data", {"a 0/0 False", "d 899999999/4 False", "e 1000000000/4 False"});
  EXPECT_EQ(refusal_of(options), "");
}

TEST(TestSplits, ProtectAssetsByAnyNameAndTheirPoses) {
  const test::TemporaryFolder folder;
  write_file_atomically(folder / "data/metadata.csv",
                        "sha256,file_identifier,uuid,variant_of\na,a.glb,uuid-a,\nb,b.glb,uuid-b,\nbx1,,,b\n");
  SourceOptions options;
  options.data_dir = (folder / "data").string();
  EXPECT_EQ(refusal_of(options), "");
  options.test_splits = {(folder / "test.txt").string()};
  write_file_atomically(folder / "test.txt", "uuid-elsewhere\n");
  EXPECT_EQ(refusal_of(options), "");
  write_file_atomically(folder / "test.txt", "uuid-b\n");
  EXPECT_NE(refusal_of(options).find("b: is kept for testing"), std::string::npos) << refusal_of(options);
  write_file_atomically(folder / "data/train.txt", "a\nbx1\n");
  options.split = "train.txt";
  EXPECT_NE(refusal_of(options).find("bx1: is kept for testing"), std::string::npos) << refusal_of(options);
}

TEST(Stream, IsReadByGenerationsBesideADatasetThatHoldsOut) {
  const test::TemporaryFolder folder;
  const StreamFolder stream{folder / "stream"};
  for (int shard = 0; shard < 3; ++shard) {
    const std::string id = "s" + std::to_string(shard), creature = " 1000000000000/" + std::to_string(shard) + " False";
    write_creatures(stream.shard(static_cast<std::uint64_t>(shard)), {id + creature});
  }
  write_creatures(folder / "tests", {"t 900000001/0 True"});
  StreamIndex index;
  stream.write_index(index);
  EXPECT_THROW(newest_generation(stream), InputError) << "nothing is made yet";
  index.generation = 2;
  index.shards = {2, 1};
  stream.write_index(index);

  SourceOptions options;
  options.data_dir = stream.root.string() + "," + (folder / "tests").string();
  options.split = "splits/train.txt";
  options.eval_split = "splits/test.txt";
  EXPECT_THROW(select(options), NotSupportedError) << "by who does not follow it";
  ASSERT_TRUE(stream_of(options.data_dir));
  const auto ids = [](const std::vector<AssetId>& assets) {
    std::string line;
    for (const AssetId& asset : assets) line += asset.id + " ";
    return line;
  };
  const auto held = newest_generation(stream);
  const TrainAndEval found = select(options, held.get());
  EXPECT_EQ(ids(found.train), "s2 s1 ");
  EXPECT_EQ(ids(found.eval), "t ");
  EXPECT_NO_THROW(refuse_test_creatures(found, options));
  EXPECT_EQ(file_of_dataset("splits/test.txt", options.data_dir), folder / "tests/splits/test.txt");
  EXPECT_FALSE(FileLock::try_lock(stream.shard_lock(1), FileLock::Kind::kExclusive)) << "held while it is read";
  EXPECT_TRUE(FileLock::try_lock(stream.shard_lock(0), FileLock::Kind::kExclusive));

  const auto other = hold_generation(stream, 1, {0, 1});
  ASSERT_TRUE(other);
  EXPECT_EQ(ids(select(options, other.get()).train), "s0 s1 ");
  std::filesystem::remove_all(stream.shard(0));
  EXPECT_FALSE(hold_generation(stream, 1, {0, 1}));
  options.eval_split.clear();
  options.eval_fraction = 0.5;
  EXPECT_THROW(select(options, held.get()), NotSupportedError);
}

}  // namespace

}  // namespace anigen::data
