#include <gtest/gtest.h>
#include <cstdlib>
#include <fstream>
#include <map>
#include <set>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/process.h"
#include "anigen/prepare/dataset_card.h"
#include "anigen/prepare/manifest.h"
#include "anigen/prepare/merge.h"
#include "anigen/prepare/run.h"
#include "tests/support/paths.h"

namespace anigen::prepare {

namespace {

namespace fs = std::filesystem;

Manifest manifest(const Shard& shard, const std::string& settings = "{}") {
  Manifest manifest;
  manifest.shard = shard;
  manifest.sources = 4;
  manifest.sources_digest = "digest";
  manifest.settings = Json::parse(settings);
  const auto sources = procedural_sources(1, 4);
  for (std::size_t i = 0; i < 4; ++i) {
    if (!shard.owns(i)) continue;
    ManifestEntry entry;
    entry.number = i;
    entry.source = sources[i];
    entry.id = "id" + std::to_string(i);
    entry.failures = {{entry.id, 1, "views", "f", "reason", ""}};
    manifest.entries.push_back(entry);
  }
  return manifest;
}

TEST(Manifests, ComeBackWhenAllShardsFinished) {
  const test::TemporaryFolder folder;
  const fs::path out = folder.path();
  EXPECT_THROW(read_manifests(out), InputError);
  write_manifest(out, manifest({1, 3}));
  write_manifest(out, manifest({0, 3}));
  try {
    read_manifests(out);
    FAIL() << "shard 2 is missing";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("3 shards have not finished: 2"), std::string::npos) << error.what();
  }
  write_manifest(out, manifest({2, 3}));
  const std::vector<Manifest> all = read_manifests(out);
  ASSERT_EQ(all.size(), 3u);
  EXPECT_EQ(all[1].entries.at(0).id, "id1");
  EXPECT_EQ(all[0].entries.at(1).source.index, 3u);
  EXPECT_EQ(all[2].entries.at(0).failures.at(0).variant, 1u);
  write_manifest(out, manifest({2, 3}, R"({"other": 1})"));
  EXPECT_THROW(read_manifests(out), InputError);
}

TEST(Manifests, OfOtherRunsAreRemoved) {
  const test::TemporaryFolder folder;
  const fs::path out = folder.path();
  write_manifest(out, manifest({0, 3}));
  write_manifest(out, manifest({1, 3}));
  write_manifest(out, manifest({2, 3}, R"({"other": 1})"));
  write_manifest(out, manifest({0, 1}));
  write_file_atomically(run_folder(out) / "sources-1-of-9.jsonl", "damaged");
  remove_other_manifests(out, manifest({1, 3}));
  EXPECT_TRUE(fs::exists(manifest_path(out, {0, 3})));
  EXPECT_FALSE(fs::exists(manifest_path(out, {1, 3})));
  EXPECT_FALSE(fs::exists(manifest_path(out, {2, 3})));
  EXPECT_FALSE(fs::exists(manifest_path(out, {0, 1})));
  EXPECT_FALSE(fs::exists(run_folder(out) / "sources-1-of-9.jsonl"));
}

TEST(FailureLogs, SurviveALineThatAKillCutOff) {
  const test::TemporaryFolder folder;
  const fs::path out = folder.path();
  fs::create_directories(run_folder(out));
  const auto sources = procedural_sources(1, 2);
  const StepFailure one{"id", 0, "views", "f", "first", ""}, two{"id", 0, "voxels", "f", "second", "rule"};
  { FailureLog(out, {}).add(sources[0], one); }
  {
    std::ofstream file(run_folder(out) / "failures-0-of-1-1.jsonl", std::ios::app);  // of a process that is gone
    file << R"({"source": "procedural/1/0", "id": "x", "vari)";
  }
  { FailureLog(out, {}).add(sources[0], two); }
  { FailureLog(out, {1, 2}).add(sources[1], two); }
  KnownFailures known = FailureLog::read(out);
  ASSERT_EQ(known["procedural/1/0"].size(), 2u);
  EXPECT_EQ(known["procedural/1/0"][1].reason, "second");
  EXPECT_EQ(known["procedural/1/1"].at(0).rule, "rule");
  FailureLog log(out, {});
  log.finish({{1, sources[1], "", "", {one}}});
  known = FailureLog::read(out);
  EXPECT_EQ(known.count("procedural/1/0"), 0u);
  EXPECT_EQ(known["procedural/1/1"].size(), 2u);
}

DatasetRow row(const std::string& id, bool is_test, std::size_t variant = 0, const std::string& of = "") {
  DatasetRow row;
  row.entry.id = id;
  row.entry.source.file = "file.glb";
  row.entry.source.is_test = is_test;
  row.entry.record.num_joints = 10;
  row.entry.record.closest_bones = 1;
  row.variant = variant;
  row.variant_of = of;
  return row;
}

TEST(Splits, KeepVariantsWithTheirSource) {
  std::vector<DatasetRow> rows;
  for (const char* id : {"a", "b", "c", "d"}) {
    rows.push_back(row(id, false));
    rows.push_back(row(std::string(id) + "1", false, 1, id));
  }
  SplitOptions options;
  options.test_count = 2;
  mark_test(rows, options, {});
  std::size_t tests = 0;
  for (std::size_t i = 0; i < rows.size(); i += 2) {
    tests += rows[i].entry.is_test;
    EXPECT_EQ(rows[i].entry.is_test, rows[i + 1].entry.is_test);
  }
  EXPECT_EQ(tests, 2u);
  const test::TemporaryFolder folder;
  const SplitCounts counts = write_splits(folder.path(), rows, {});
  EXPECT_EQ(counts.test, 2u);
  EXPECT_EQ(counts.train, 4u);
  EXPECT_EQ(read_file(folder / "splits/test.txt").size(), 4u);           // two ids of one letter
  EXPECT_EQ(read_file(folder / "splits/test_variants.txt").size(), 6u);  // two of two letters
}

// A dataset that is given lists its poses as assets of their own.
TEST(Splits, KeepPosesOfADatasetWithTheirSource) {
  const auto made = [](const SplitOptions& options) {
    std::vector<DatasetRow> rows;
    for (const char* id : {"a", "b", "c", "d"}) {
      rows.push_back(row(id, false));
      rows.push_back(row(std::string(id) + "1", false));
      rows.back().entry.source.variant_of = id;
      rows.push_back(row(std::string(id) + "12", false, 1, std::string(id) + "1"));  // posed again
    }
    mark_test(rows, options, {});
    std::size_t tests = 0;
    for (std::size_t i = 0; i < rows.size(); i += 3) {
      tests += rows[i].entry.is_test;
      EXPECT_EQ(rows[i].entry.is_test, rows[i + 1].entry.is_test);
      EXPECT_EQ(rows[i].entry.is_test, rows[i + 2].entry.is_test);
    }
    const test::TemporaryFolder folder;
    EXPECT_EQ(write_splits(folder.path(), rows, {}).test, tests) << "poses are listed by themselves";
    return tests;
  };
  SplitOptions options;
  options.test_count = 2;
  EXPECT_EQ(made(options), 2u);
  SplitOptions named;
  named.test_names = {"c"};
  EXPECT_EQ(made(named), 1u);
  named.test_names = {"c1"};
  EXPECT_EQ(made(named), 1u) << "a pose takes its source along";
}

TEST(Splits, KeepAssetsOfOneSkeletonTogether) {
  // Twelve assets of four skeletons: 1, 2, 4 and 5 of one.
  std::vector<DatasetRow> rows;
  const std::vector<std::size_t> sizes{1, 2, 4, 5};
  for (std::size_t k = 0; k < sizes.size(); ++k) {
    for (std::size_t i = 0; i < sizes[k]; ++i) {
      const std::string id = std::to_string(k) + "-" + std::to_string(i);
      rows.push_back(row(id, true));  // flags of the source do not count
      rows.back().entry.record.skeleton.topology = "tree" + std::to_string(k);
      rows.push_back(row(id + "v", false, 1, id));
    }
  }
  SplitOptions options;
  options.by_skeleton = true;
  options.test_fraction = 0.5;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    options.seed = seed;
    mark_test(rows, options, {});
    std::map<char, std::set<bool>> sides;
    for (const DatasetRow& one : rows) sides[one.entry.id[0]].insert(one.entry.is_test);
    std::size_t tests = 0;
    for (const auto& [skeleton, side] : sides) {
      EXPECT_EQ(side.size(), 1u) << skeleton << " with seed " << seed;
      tests += *side.begin();
    }
    EXPECT_EQ(tests, 2u) << "half of the skeletons, not of the assets";
  }
  EXPECT_TRUE(SplitOptions::from_json(options.to_json()).by_skeleton);
  options.test_fraction.reset();
  options.test_count = 5;
  EXPECT_THROW(mark_test(rows, options, {}), InputError);
}

TEST(Splits, KeepTheTestFlagsOfASourceUnlessAskedOtherwise) {
  std::vector<DatasetRow> rows{row("a", false), row("b", true), row("c", false), row("d", false)};
  mark_test(rows, {}, {});
  EXPECT_TRUE(rows[1].entry.is_test);
  EXPECT_FALSE(rows[0].entry.is_test || rows[2].entry.is_test || rows[3].entry.is_test);
  SplitOptions none;
  none.test_count = 0;
  mark_test(rows, none, {});
  EXPECT_FALSE(rows[1].entry.is_test);
  SplitOptions many;
  many.test_count = 5;
  EXPECT_THROW(mark_test(rows, many, {}), InputError);
}

TEST(Splits, TakeTheTestAssetsThatAListNames) {
  std::vector<DatasetRow> rows{row("a", true), row("b", false), row("c", false), row("d", false),
                               row("b1", false, 1, "b")};
  rows[1].entry.source.uuid = rows[4].entry.source.uuid = "u-b";
  rows[2].entry.source.local_path = "fish/manta.glb";
  rows[3].entry.record.num_joints = 1;  // not usable
  const auto marked = [&](std::vector<std::string> names) {
    SplitOptions options;
    options.test_names = std::move(names);
    EXPECT_EQ(SplitOptions::from_json(options.to_json()).test_names, options.test_names);
    mark_test(rows, options, {});
    std::string ids;
    for (const DatasetRow& one : rows) ids += one.entry.is_test ? one.entry.id + " " : "";
    return ids;
  };
  EXPECT_EQ(marked({"u-b", "manta", "d", "of nobody"}), "b c b1 ");
  EXPECT_EQ(marked({"a"}), "a ");
  EXPECT_THROW(marked({"of nobody"}), InputError);
  rows[3].entry.source.uuid = "u-b";
  EXPECT_THROW(marked({"u-b"}), InputError) << "b or d?";
}

TEST(Tables, SayWhatIsThereForEveryRow) {
  std::vector<DatasetRow> rows{row("a", false), row("b", false)};
  rows[0].records.steps["voxels"].columns = {{"num_voxels", 12}, {"num_skeleton_voxels", 3}};
  rows[0].records.steps["features/surface"] = {};
  rows[0].aesthetic_score = "5.5";
  CsvTable table = dataset_table(rows, {});
  EXPECT_EQ(table.cell(0, "num_voxels"), "12");
  EXPECT_EQ(table.cell(1, "num_voxels"), "0");  // no empty cells: readers take columns as numbers and masks
  EXPECT_EQ(table.cell(0, "voxelized"), "True");
  EXPECT_EQ(table.cell(1, "feature_surface"), "False");
  EXPECT_EQ(table.column("aesthetic_score"), CsvTable::kMissing);  // one row has none
  rows[1].aesthetic_score = "4";
  table = dataset_table(rows, {});
  EXPECT_EQ(table.cell(1, "aesthetic_score"), "4");
}

TEST(Cards, EscapeWhatTheyQuote) {
  CardFacts facts;
  facts.tables = {{"Failures", "", {"a|b"}, {{"<script>|\n"}}}};
  const std::string html = card_html(facts, {"sha256"}, {});
  EXPECT_EQ(html.find("<script>"), std::string::npos);
  EXPECT_NE(html.find("&lt;script&gt;"), std::string::npos);
  EXPECT_NE(card_markdown(facts, {}, false).find("| <script>\\|  |"), std::string::npos);
}

TEST(Histograms, CountEveryValueOnce) {
  for (const std::vector<double>& values :
       {std::vector<double>{3}, std::vector<double>{1, 2, 3, 4, 100}, std::vector<double>{5, 80000, 17, 300, 300},
        std::vector<double>{0, 0, 7}, std::vector<double>{2, 2e9}}) {
    const auto bins = histogram(values);
    std::size_t total = 0;
    for (std::size_t i = 0; i < bins.size(); ++i) {
      std::size_t inside = 0;
      for (const double value : values) inside += value >= bins[i].low && value < bins[i].high;
      if (i + 1 < bins.size()) {
        EXPECT_EQ(bins[i].count, inside) << bins[i].low;
      }
      total += bins[i].count;
    }
    EXPECT_EQ(total, values.size());
    EXPECT_LE(bins.size(), 12u);
  }
  EXPECT_TRUE(histogram({}).empty());
  EXPECT_EQ(histogram_svg({}), "");
}

}  // namespace

namespace {

TEST(Shards, ArePartsOfTheSources) {
  const Shard shard = parse_shard("1/3");
  EXPECT_EQ(shard, (Shard{1, 3}));
  EXPECT_EQ(shard.name(), "1-of-3");
  EXPECT_FALSE(shard.owns(0));
  EXPECT_TRUE(shard.owns(1));
  EXPECT_TRUE(shard.owns(4));
  for (const char* wrong : {"", "/", "3/3", "-1/3", "1/", "/3", "1/3x", " 1/3", "1", "0/0"})
    EXPECT_THROW(parse_shard(wrong), InputError) << wrong;
}

Manifest run_of(const Shard& shard, std::size_t sources = 3) {
  Manifest run;
  run.shard = shard;
  run.sources = sources;
  run.settings = Json::object();
  return run;
}

TEST(RunMemberships, GoTogetherWhenTheRunIsTheSame) {
  const test::TemporaryFolder folder;
  {
    const FileLock first = join_run(folder.path(), run_of({0, 2}));
    EXPECT_NO_THROW((void)join_run(folder.path(), run_of({0, 2})));
    EXPECT_NO_THROW((void)join_run(folder.path(), run_of({1, 2})));
    EXPECT_THROW((void)join_run(folder.path(), run_of({})), InputError);         // other shards
    EXPECT_THROW((void)join_run(folder.path(), run_of({0, 2}, 4)), InputError);  // other sources
    EXPECT_THROW((void)take_alone(folder.path()), InputError);                   // a merge
  }
  {
    const FileLock merge = take_alone(folder.path());
    EXPECT_THROW((void)join_run(folder.path(), run_of({0, 2})), InputError);
  }
  EXPECT_NO_THROW((void)join_run(folder.path(), run_of({}, 4)));
}

TEST(RunMemberships, AndEncodersKeepEachOtherOut) {
  const test::TemporaryFolder folder;
  {
    const auto encoder = FileLock::try_lock(dataset_lock_file(folder.path()), FileLock::Kind::kShared);
    EXPECT_THROW((void)join_run(folder.path(), run_of({})), InputError);
    EXPECT_THROW((void)take_alone(folder.path()), InputError);
  }
  EXPECT_NO_THROW((void)join_run(folder.path(), run_of({})));
}

TEST(RunMemberships, TheFirstBeginsAnewUnlessItIsOfTheSameArray) {
  const test::TemporaryFolder folder;
  const std::filesystem::path piece = pieces_folder(folder.path()) / "prepare-0-of-1-000000.json";
  const auto stays = [&] {
    write_file_atomically(piece, "[]");
    (void)join_run(folder.path(), run_of({}));
    return std::filesystem::exists(piece);
  };
  ::unsetenv("SLURM_ARRAY_JOB_ID");
  EXPECT_FALSE(stays());
  EXPECT_FALSE(stays()) << "the same command again looks at everything again";
  ::setenv("SLURM_ARRAY_JOB_ID", "17", 1);
  EXPECT_FALSE(stays());
  EXPECT_TRUE(stays()) << "a task that starts late";
  ::setenv("SLURM_ARRAY_JOB_ID", "18", 1);
  EXPECT_FALSE(stays());
  ::unsetenv("SLURM_ARRAY_JOB_ID");
  {
    const FileLock working = join_run(folder.path(), run_of({}));
    EXPECT_TRUE(stays()) << "who joins goes on";
  }
}

TEST(Pieces, HoldEveryTaskOnceAndForgetDamagedFiles) {
  const test::TemporaryFolder folder;
  const Pieces pieces(folder.path(), "prepare", {}, 7, 3);
  ASSERT_EQ(pieces.size(), 3u);
  EXPECT_EQ(pieces.range(2), (std::pair<std::size_t, std::size_t>{6, 7}));
  EXPECT_EQ(pieces.of_task(5), 1u);
  EXPECT_EQ(Pieces(folder.path(), "prepare", {}, 0, 3).size(), 0u);
  EXPECT_FALSE(pieces.read(2));
  SourceOutcome outcome;
  outcome.number = 12;
  pieces.write(2, {outcome});
  ASSERT_TRUE(pieces.read(2));
  EXPECT_EQ(pieces.read(2)->at(0).number, 12u);
  pieces.write(2, {outcome, outcome});
  EXPECT_FALSE(pieces.read(2)) << "of a run with other pieces";
  write_file_atomically(pieces_folder(folder.path()) / (pieces.name(2) + ".json"), "[{");
  EXPECT_FALSE(pieces.read(2));
}

TEST(Sweep, RemovesWhatKilledWritersLeftAndNothingElse) {
  const test::TemporaryFolder folder;
  for (const char* name : {"a.tmp-12-0.json", "deep/er/b.tmp-1-22", "renders/x/000.tmp-9-1.png"})
    write_file_atomically(folder / name, "stale");
  for (const char* name : {"a.json", "b.tmp", "c.tmp-.json", "d.tmp-1.json", "e.tmp-1-2x.json", "f.tmp-a-1.json"})
    write_file_atomically(folder / name, "kept");
  EXPECT_EQ(sweep_temporary_files(folder.path()), 3u);
  EXPECT_EQ(sweep_temporary_files(folder.path()), 0u);
  EXPECT_TRUE(std::filesystem::exists(folder / "f.tmp-a-1.json"));
  EXPECT_TRUE(std::filesystem::is_empty(folder / "deep/er"));
}

}  // namespace

}  // namespace anigen::prepare
