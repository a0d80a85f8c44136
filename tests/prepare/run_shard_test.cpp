#include "anigen/prepare/run/shard.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
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

class SlurmVariables : public testing::Test {
 protected:
  void SetUp() override { clear(); }
  void TearDown() override { clear(); }
  static void clear() {
    for (const char* name : {"ID", "MIN", "COUNT", "STEP"})
      ::unsetenv((std::string("SLURM_ARRAY_TASK_") + name).c_str());
  }
  static void set(const char* name, const char* value) {
    ::setenv((std::string("SLURM_ARRAY_TASK_") + name).c_str(), value, 1);
  }
};

TEST_F(SlurmVariables, GiveTheShardOfAnArrayJob) {
  EXPECT_FALSE(slurm_shard().has_value());
  set("ID", "7");
  EXPECT_FALSE(slurm_shard().has_value());  // no array: somebody's leftover variable
  set("MIN", "5");
  set("COUNT", "4");
  EXPECT_EQ(*slurm_shard(), (Shard{2, 4}));
  set("STEP", "2");
  EXPECT_EQ(*slurm_shard(), (Shard{1, 4}));
  set("STEP", "3");
  EXPECT_THROW(slurm_shard(), InputError);  // an array with gaps
  set("STEP", "1");
  set("ID", "9");
  EXPECT_THROW(slurm_shard(), InputError);
  set("ID", "x");
  EXPECT_THROW(slurm_shard(), InputError);
}

// "sbatch --array=17" after task 17 of 64 failed must not become the whole dataset.
TEST_F(SlurmVariables, OfAnArrayOfOneTaskDoNotSayWhichShardItIs) {
  set("ID", "17");
  set("MIN", "17");
  set("COUNT", "1");
  EXPECT_THROW(slurm_shard(), InputError);
}

TEST(RunLocks, KeepTwoRunsOfTheSamePartApart) {
  const test::TemporaryFolder folder;
  {
    const RunLock first(folder.path(), {0, 2});
    EXPECT_THROW(RunLock(folder.path(), Shard{0, 2}), InputError);  // the same shard
    EXPECT_NO_THROW(RunLock(folder.path(), Shard{1, 2}));           // another one
    EXPECT_THROW(RunLock(folder.path(), Shard{}), InputError);      // everything, or a merge
  }
  const RunLock whole(folder.path(), {});
  EXPECT_THROW(RunLock(folder.path(), Shard{1, 2}), InputError);
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
