#include "anigen/models/run_model.h"

#include <gtest/gtest.h>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen::models {
namespace {

class RunModelTest : public testing::Test {
 protected:
  RunModelTest() {
    write_file_atomically(folder_ / "config.json",
                          R"({"models": {"encoder": {"name": "E", "args": {"a": 1}}, "decoder": {"name": "D"}}})");
  }
  void weights(const std::string& name) { write_file_atomically(folder_ / "ckpts" / name, "weights"); }
  std::string chosen(const std::string& class_name, const std::string& ckpt = "") {
    return find_run_model(folder_.path(), class_name, ckpt).checkpoint.filename().string();
  }
  test::TemporaryFolder folder_;
};

TEST_F(RunModelTest, TakesTheNewestOfItsOwnFilesAveragedFirst) {
  for (const char* name :
       {"encoder_step0000010.safetensors", "encoder_ema0.99_step0000010.safetensors", "encoder_step0000009.safetensors",
        "decoder_step0000020.safetensors", "state_step0000030.safetensors", "encoder_step0000040.txt"}) {
    weights(name);
  }
  EXPECT_EQ(chosen("E"), "encoder_ema0.99_step0000010.safetensors");
  EXPECT_EQ(chosen("D"), "decoder_step0000020.safetensors");
  weights("encoder_step0000011.safetensors");
  EXPECT_EQ(chosen("E"), "encoder_step0000011.safetensors") << "a later step beats an average";
  EXPECT_EQ(chosen("E", "final"), "encoder_step0000011.safetensors") << "there is no file of that name";
  EXPECT_EQ(chosen("E", "step0000009"), "encoder_step0000009.safetensors");
  EXPECT_THROW(chosen("E", "step0000008"), InputError);
  weights("encoder_final.pt");
  EXPECT_EQ(chosen("E", "final"), "encoder_final.pt");
}

TEST_F(RunModelTest, TakesWholeSetsBeforeWhatAKilledRunLeft) {
  weights("encoder_step0000010.safetensors");
  weights("encoder_step0000030.tmp-12-3.safetensors");
  EXPECT_EQ(chosen("E"), "encoder_step0000010.safetensors");
  weights("encoder_step0000020.safetensors");
  EXPECT_EQ(chosen("E"), "encoder_step0000020.safetensors") << "no state, as in released folders";
  weights("state_step0000010.safetensors");
  EXPECT_EQ(chosen("E"), "encoder_step0000010.safetensors") << "the decoder of step 20 may never have been written";
  weights("state_step0000020.tmp-12-4.safetensors");
  EXPECT_EQ(chosen("E"), "encoder_step0000010.safetensors");
  weights("state_step0000020.safetensors");
  EXPECT_EQ(chosen("E"), "encoder_step0000020.safetensors");
}

TEST_F(RunModelTest, TellsArgumentsAndWhatIsMissing) {
  EXPECT_THROW(find_run_model(folder_.path(), "E"), InputError) << "no weights";
  weights("encoder_step0000001.safetensors");
  const RunModel found = find_run_model(folder_.path(), "E");
  EXPECT_EQ(found.name, "encoder");
  EXPECT_EQ(found.args.at("a"), 1);
  EXPECT_EQ(found.pointer, "/models/encoder/args");
  EXPECT_THROW(find_run_model(folder_.path(), "Other"), InputError);
  EXPECT_THROW(find_run_model(folder_ / "absent", "E"), InputError);
}

}  // namespace
}  // namespace anigen::models
