#include "anigen/prepare/run/shard.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/file_lock.h"
#include "anigen/prepare/run/pieces.h"
#include "anigen/prepare/run/run_lock.h"
#include "tests/support/paths.h"

namespace anigen::prepare {
namespace {

TEST(Shards, ArePartsOfTheSources) {
  const Shard shard = parse_shard("1/3");
  EXPECT_EQ(shard, (Shard{1, 3}));
  EXPECT_EQ(shard.name(), "1-of-3");
  EXPECT_FALSE(shard.owns(0));
  EXPECT_TRUE(shard.owns(1));
  EXPECT_TRUE(shard.owns(4));
  for (const char* wrong : {"", "/", "3/3", "-1/3", "1/", "/3", "1/3x", " 1/3", "1", "0/0"}) {
    EXPECT_THROW(parse_shard(wrong), InputError) << wrong;
  }
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
    const RunMembership first(folder.path(), run_of({0, 2}));
    EXPECT_NO_THROW(RunMembership(folder.path(), run_of({0, 2})));
    EXPECT_NO_THROW(RunMembership(folder.path(), run_of({1, 2})));
    EXPECT_THROW(RunMembership(folder.path(), run_of({})), InputError);         // other shards
    EXPECT_THROW(RunMembership(folder.path(), run_of({0, 2}, 4)), InputError);  // other sources
    EXPECT_THROW(RunAlone(folder.path()), InputError);                          // a merge
  }
  {
    const RunAlone merge(folder.path());
    EXPECT_THROW(RunMembership(folder.path(), run_of({0, 2})), InputError);
  }
  EXPECT_NO_THROW(RunMembership(folder.path(), run_of({}, 4)));
}

TEST(RunMemberships, AndEncodersKeepEachOtherOut) {
  const test::TemporaryFolder folder;
  {
    const auto encoder = FileLock::try_lock(dataset_lock_file(folder.path()), FileLock::Kind::kShared);
    EXPECT_THROW(RunMembership(folder.path(), run_of({})), InputError);
    EXPECT_THROW(RunAlone(folder.path()), InputError);
  }
  EXPECT_NO_THROW(RunMembership(folder.path(), run_of({})));
}

TEST(RunMemberships, TheFirstBeginsAnewUnlessItIsOfTheSameArray) {
  const test::TemporaryFolder folder;
  const std::filesystem::path piece = pieces_folder(folder.path()) / "prepare-0-of-1-000000.json";
  const auto stays = [&] {
    write_file_atomically(piece, "[]");
    RunMembership(folder.path(), run_of({}));
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
    const RunMembership working(folder.path(), run_of({}));
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
  for (const char* name : {"a.tmp-12-0.json", "deep/er/b.tmp-1-22", "renders/x/000.tmp-9-1.png"}) {
    write_file_atomically(folder / name, "stale");
  }
  for (const char* name : {"a.json", "b.tmp", "c.tmp-.json", "d.tmp-1.json", "e.tmp-1-2x.json", "f.tmp-a-1.json"}) {
    write_file_atomically(folder / name, "kept");
  }
  EXPECT_EQ(sweep_temporary_files(folder.path()), 3u);
  EXPECT_EQ(sweep_temporary_files(folder.path()), 0u);
  EXPECT_TRUE(std::filesystem::exists(folder / "f.tmp-a-1.json"));
  EXPECT_TRUE(std::filesystem::is_empty(folder / "deep/er"));
}

}  // namespace
}  // namespace anigen::prepare
