#include "anigen/train/trainer_state.h"

#include <gtest/gtest.h>

#include <fstream>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/table.h"
#include "tests/support/paths.h"

namespace anigen::train {
namespace {

namespace fs = std::filesystem;

class Checkpoints : public ::testing::Test {
 protected:
  void save(std::int64_t step, float value = 1.0f) {
    SavedState state;
    state.arrays.emplace_back("moment", io::NdArray::from(std::vector<float>{value, 2 * value}, {2}));
    state.numbers = {{"scale", 15.001}, {"threshold", std::numeric_limits<double>::infinity()}};
    const io::NdArray weights = io::NdArray::from(std::vector<float>{value}, {1});
    checkpoints_.save(step, {{"model", {{"w", weights}}}, {ema_name("model", 0.9999), {{"w", weights}}}}, state);
  }
  test::TemporaryFolder folder_;
  CheckpointFolder checkpoints_{folder_ / "ckpts"};
};

TEST_F(Checkpoints, NamesAndContentsReadBack) {
  save(100, 3.5f);
  EXPECT_TRUE(fs::exists(folder_ / "ckpts/model_step0000100.safetensors"));
  EXPECT_TRUE(fs::exists(folder_ / "ckpts/model_ema0.9999_step0000100.safetensors"));
  EXPECT_TRUE(fs::exists(folder_ / "ckpts/state_step0000100.safetensors"));
  EXPECT_EQ(checkpoints_.weights("model", 100).front().second.as<float>().front(), 3.5f);
  const SavedState state = checkpoints_.state(100);
  EXPECT_EQ(state.arrays.front().second.as<float>()[1], 7.0f);
  EXPECT_EQ(state.numbers.at("scale").get<double>(), 15.001);
  EXPECT_TRUE(state.numbers.at("threshold").is_null());
}

TEST_F(Checkpoints, KeepsTheTwoNewestAndRoundOnes) {
  for (const std::int64_t step : {100'000, 100'100, 200'000, 200'100, 200'200}) save(step);
  EXPECT_EQ(checkpoints_.steps(), (std::vector<std::int64_t>{100'000, 200'000, 200'100, 200'200}));
  EXPECT_FALSE(checkpoints_.has("model", 100'100));
}

TEST_F(Checkpoints, TheSetJustWrittenIsKeptBelowLaterOnes) {
  for (const std::int64_t step : {220, 240, 30}) save(step);
  EXPECT_EQ(checkpoints_.steps(), (std::vector<std::int64_t>{30, 220, 240}));
  save(40);
  save(50);
  EXPECT_EQ(checkpoints_.steps(), (std::vector<std::int64_t>{40, 50, 220, 240})) << "two of its own, no other's";
}

// A state of a terabyte that takes no room on the disk: reading it would need as much memory.
TEST_F(Checkpoints, CompleteSetsAreFoundByTheHeadersOfTheirStates) {
  save(100);
  const fs::path state = checkpoints_.file("state", 100), model = checkpoints_.file("model", 100);
  const std::string header =
      R"({"__metadata__":{"state":"{\"step\":100,\"files\":{\")" + model.filename().string() + R"(\":)" +
      std::to_string(fs::file_size(model)) +
      R"(},\"numbers\":{}}"},"optimizer.exp_avg":{"dtype":"U8","shape":[1099511627776],"data_offsets":[0,1099511627776]}})";
  std::string length(8, '\0');
  for (std::size_t i = 0; i < 2; ++i) length[i] = static_cast<char>(header.size() >> (8 * i));
  write_file_atomically(state, length + header);
  fs::resize_file(state, length.size() + header.size() + (std::uintmax_t{1} << 40));
  EXPECT_EQ(checkpoints_.latest(), 100);
  EXPECT_EQ(checkpoints_.steps(), std::vector<std::int64_t>{100});
  fs::resize_file(state, fs::file_size(state) - 1);
  EXPECT_FALSE(checkpoints_.complete(100)) << "the data are cut";
}

TEST_F(Checkpoints, LaterStepsAreMovedAsideAndCanBeLoadedFromThere) {
  for (const std::int64_t step : {220, 240, 20}) save(step, static_cast<float>(step));
  std::ofstream(folder_ / "metrics.csv") << "step,loss\n10,3\n20,2\n220,1\n230,0.5\n";
  for (const char* step : {"step20", "step220", "final"}) fs::create_directories(folder_ / "samples" / step);
  EXPECT_EQ(set_later_steps_aside(folder_.path(), 240), std::nullopt);

  const fs::path first = set_later_steps_aside(folder_.path(), 20).value();
  EXPECT_EQ(first, folder_ / "ckpts/abandoned-220-1");
  EXPECT_EQ(checkpoints_.steps(), std::vector<std::int64_t>{20});
  EXPECT_EQ(CheckpointFolder(first).steps(), (std::vector<std::int64_t>{220, 240}));
  EXPECT_EQ(checkpoint_files_of(first), first);
  EXPECT_EQ(checkpoint_files_of(folder_.path()), folder_ / "ckpts");
  EXPECT_EQ(CheckpointFolder(first).weights("model", 240).front().second.as<float>().front(), 240.0f);
  EXPECT_EQ(read_file(folder_ / "metrics.csv"), "step,loss\n10,3\n20,2\n");
  EXPECT_EQ(read_file(first / "metrics.csv"), "step,loss\n220,1\n230,0.5\n");
  EXPECT_TRUE(fs::exists(first / "samples/step220"));
  EXPECT_TRUE(fs::exists(folder_ / "samples/step20"));
  EXPECT_TRUE(fs::exists(folder_ / "samples/final"));

  save(220);
  const fs::path second = set_later_steps_aside(folder_.path(), 20).value();
  EXPECT_EQ(second, folder_ / "ckpts/abandoned-220-2");
  EXPECT_EQ(CheckpointFolder(first).steps(), (std::vector<std::int64_t>{220, 240})) << "untouched";
  save(30);
  save(40);
  EXPECT_EQ(CheckpointFolder(second).steps(), std::vector<std::int64_t>{220}) << "no clean-up reaches it";
}

TEST_F(Checkpoints, ASetWithoutItsStateDoesNotExist) {
  save(100);
  save(200);
  fs::remove(folder_ / "ckpts/state_step0000200.safetensors");
  EXPECT_EQ(checkpoints_.latest(), 100);
}

TEST_F(Checkpoints, AMissingOrShortenedFileInvalidatesItsSet) {
  save(100);
  save(200);
  save(300);
  fs::remove(checkpoints_.file("model_ema0.9999", 300));
  EXPECT_EQ(checkpoints_.latest(), 200);
  fs::resize_file(checkpoints_.file("model", 200), fs::file_size(checkpoints_.file("model", 200)) - 1);
  EXPECT_EQ(checkpoints_.latest(), std::nullopt) << "100 was deleted by the retention rule";
}

TEST_F(Checkpoints, ATornStateIsPassedOver) {
  save(100);
  save(200);
  fs::resize_file(checkpoints_.file("state", 200), 20);
  EXPECT_EQ(checkpoints_.latest(), 100);
}

TEST_F(Checkpoints, LeftoversOfACrashAreIgnoredAndSwept) {
  save(100);
  std::ofstream(folder_ / "ckpts/model_step0000150.tmp-1-0.safetensors") << "torn";
  std::ofstream(folder_ / "ckpts/model_step0000150.safetensors") << "no state was written";
  std::ofstream(folder_ / "ckpts/notes.txt") << "mine";
  EXPECT_EQ(checkpoints_.latest(), 100);
  save(200);
  EXPECT_FALSE(fs::exists(folder_ / "ckpts/model_step0000150.tmp-1-0.safetensors"));
  EXPECT_FALSE(fs::exists(folder_ / "ckpts/model_step0000150.safetensors"));
  EXPECT_TRUE(fs::exists(folder_ / "ckpts/notes.txt"));
}

TEST_F(Checkpoints, NothingThere) {
  EXPECT_EQ(checkpoints_.latest(), std::nullopt);
  EXPECT_THROW(checkpoints_.weights("model", 3), InputError);
}

}  // namespace
}  // namespace anigen::train
