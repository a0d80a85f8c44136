#include "anigen/train/checkpoint.h"

#include <gtest/gtest.h>

#include <fstream>
#include <limits>

#include "anigen/core/error.h"
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
