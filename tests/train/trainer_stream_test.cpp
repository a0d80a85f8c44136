#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/process.h"
#include "anigen/core/run_folder.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/train/trainer_state.h"
#include "tests/train/trainer_run.h"

namespace anigen::train {
namespace {

// A stream of two shards with three rigs each of its own.
class StreamRun : public TrainerRun {
 protected:
  void SetUp() override {
    TrainerRun::SetUp();
    for (std::uint64_t shard = 0; shard < 3; ++shard) write_shard(shard, 1'000'000'000'000);
    show(1, {0, 1}, {});
  }
  void write_shard(std::uint64_t shard, std::uint64_t seed) {
    std::string table = "sha256,file_identifier,is_test\n";
    for (std::uint64_t i = 0; i < 3; ++i) {
      const std::uint64_t index = 3 * shard + i;
      const std::string id = "rig" + std::to_string(index);
      io::write_npz(test::rig_file(stream_.shard(shard), id),
                    test::synthetic_rig(index, 4 + static_cast<int>(index % 5)));
      table += id + ",procedural/" + std::to_string(seed) + "/" + std::to_string(index) + ",False\n";
    }
    write_file_atomically(stream_.shard(shard) / "metadata.csv", table);
  }
  void show(std::uint64_t generation, std::vector<std::uint64_t> shards, std::vector<std::uint64_t> before) {
    stream_.write_index({generation, std::move(shards), std::move(before), nullptr});
  }
  TrainCommand streamed(const std::string& output, int steps, int save_every) {
    TrainCommand streamed = command(output, {"dataset.args.eval_fraction=0", "trainer.args.i_eval=0",
                                             "trainer.args.max_steps=" + std::to_string(steps),
                                             "trainer.args.i_save=" + std::to_string(save_every)});
    streamed.data_dir = stream_.root.string();
    return streamed;
  }
  Json saved_shards(const std::string& run, std::int64_t step) {
    return CheckpointFolder(folder_ / run / "ckpts").state(step).numbers.at("stream");
  }

  const StreamFolder stream_{folder_ / "stream"};
};

TEST_F(StreamRun, TakesNewShardsAtACheckpointAndLetsTheOldOnesGo) {
  train(streamed("run", 4, 4));
  EXPECT_EQ(stream_.used_generation(), 1u);
  EXPECT_EQ(saved_shards("run", 4), (Json{{"generation", 1}, {"shards", {0, 1}}}));
  show(2, {2, 1}, {0, 1});
  train(streamed("run", 400, 4));
  EXPECT_EQ(saved_shards("run", 400), (Json{{"generation", 2}, {"shards", {2, 1}}}));
  EXPECT_EQ(stream_.used_generation(), 2u);
  EXPECT_TRUE(FileLock::try_lock(stream_.shard_lock(0), FileLock::Kind::kExclusive));
  EXPECT_NE(bytes("run/log.txt").find("generation 2 of the stream, shards 2, 1"), std::string::npos);
}

TEST_F(StreamRun, GoesOnWithTheShardsThatTheCheckpointNames) {
  const std::string file = "ckpts/model_step0000012.safetensors";
  train(streamed("whole", 12, 100));
  for (const char* legs : {"legs", "late"}) train(streamed(legs, 7, 100));
  show(2, {2, 1}, {0, 1});
  train(streamed("legs", 12, 100));
  EXPECT_EQ(bytes("whole/" + file), bytes("legs/" + file));
  EXPECT_EQ(saved_shards("legs", 12).at("generation"), 1);
  // Gone: said, and recorded.
  std::filesystem::remove_all(stream_.shard(0));
  train(streamed("late", 12, 100));
  EXPECT_NE(bytes("late/log.txt").find("of the stream, which the checkpoint of step 7 names, are gone"),
            std::string::npos);
  EXPECT_EQ(saved_shards("late", 12).at("generation"), 2);
  EXPECT_NE(bytes("whole/" + file), bytes("late/" + file));
}

TEST_F(StreamRun, RefusesATestCreatureInAnyShard) {
  train(streamed("run", 4, 4));
  write_shard(2, 900'000'005);
  show(2, {2, 1}, {0, 1});
  try {
    train(streamed("run", 4000, 4));
    FAIL() << "expected an error";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("rig6: creature procedural/900000005/6, seed 900000005"),
              std::string::npos)
        << error.what();
  }
  EXPECT_EQ(stream_.used_generation(), 1u);
}

}  // namespace
}  // namespace anigen::train
