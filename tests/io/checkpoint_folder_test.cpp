#include "anigen/io/checkpoint_folder.h"

#include <gtest/gtest.h>

#include "anigen/core/json.h"
#include "tests/io/array_file_bytes.h"

namespace anigen::io {
namespace {

class CheckpointFolder : public ::testing::Test {
 protected:
  void add(const std::string& name) { write_file_atomically(folder_ / "ckpts" / name, "x"); }
  std::string flow(bool ema) { return choose_flow_checkpoint(folder_.path(), ema).filename().string(); }
  test::TemporaryFolder folder_;
};

TEST_F(CheckpointFolder, StepsOfNames) {
  EXPECT_EQ(step_of("denoiser_step0000200.pt"), 200);
  EXPECT_EQ(step_of("denoiser_ema0.9999_step0001000.safetensors"), 1000);
  EXPECT_EQ(step_of("step5_step7.pt"), 7);
  EXPECT_EQ(step_of("denoiser.pt"), -1);
  EXPECT_EQ(step_of("denoiser_stepfinal.pt"), -1);
  EXPECT_EQ(step_of("denoiser_step99999999999999999999999.pt"), -1);
}

TEST_F(CheckpointFolder, HighestStepWinsNumerically) {
  add("denoiser_step9.pt");
  add("denoiser_step0000010.pt");
  add("denoiser.pt");
  add("denoiser_ema0.9999_step0000012.pt");
  add("misc_step0000099.pt");
  add("state_step0000099.safetensors");
  add("notes_step0000099.txt");
  EXPECT_EQ(flow(false), "denoiser_step0000010.pt");
  EXPECT_EQ(flow(true), "denoiser_ema0.9999_step0000012.pt");
  EXPECT_EQ(latest_step(folder_.path()), 99);
  EXPECT_EQ(latest_step(folder_ / "ckpts"), 99);
}

TEST_F(CheckpointFolder, FilesOfKilledWritersDoNotCount) {
  add("denoiser_step0000010.safetensors");
  add("denoiser_step0000020.tmp-123-4.safetensors");
  add("state_step0000020.tmp-123-5.safetensors");
  EXPECT_EQ(flow(false), "denoiser_step0000010.safetensors");
  EXPECT_EQ(latest_step(folder_.path()), 10);
  EXPECT_EQ(checkpoint_names(folder_ / "ckpts"), std::vector<std::string>{"denoiser_step0000010.safetensors"});
}

TEST_F(CheckpointFolder, SafetensorsCountAndPtWinsTies) {
  add("denoiser_step0000010.safetensors");
  EXPECT_EQ(flow(false), "denoiser_step0000010.safetensors");
  EXPECT_EQ(flow(true), "denoiser_step0000010.safetensors");
  add("denoiser_step0000010.pt");
  EXPECT_EQ(flow(false), "denoiser_step0000010.pt");
  add("denoiser_step0000011.safetensors");
  EXPECT_EQ(flow(false), "denoiser_step0000011.safetensors");
}

TEST_F(CheckpointFolder, NamedFiles) {
  add("final.pt");
  EXPECT_EQ(choose_decoder_checkpoint(folder_.path(), "final").filename(), "final.pt");
  add("decoder_final.safetensors");
  add("encoder_final.pt");
  EXPECT_EQ(choose_decoder_checkpoint(folder_.path(), "final").filename(), "decoder_final.safetensors");
  EXPECT_EQ(choose_checkpoint(folder_.path(), "encoder", "final").filename(), "encoder_final.pt");
  try {
    choose_decoder_checkpoint(folder_.path(), "best");
    FAIL() << "a missing checkpoint was found";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("decoder_best.pt"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("encoder_final.pt"), std::string::npos) << error.what();
  }
}

TEST_F(CheckpointFolder, NothingToChoose) {
  EXPECT_THROW(choose_flow_checkpoint(folder_ / "missing", false), InputError);
  EXPECT_EQ(latest_step(folder_ / "missing"), std::nullopt);
  add("misc_step0000001.pt");
  EXPECT_THROW(flow(false), InputError);
  EXPECT_THROW(flow(true), InputError);
}

TEST(CheckpointFolderFixtures, ExpectedFiles) {
  const auto fixture = test::parity_file("ckpt_selection.json"), root = fixture.parent_path() / "ckpt_selection";
  if (!std::filesystem::exists(fixture)) GTEST_SKIP() << "no " << fixture;
  int checked = 0;
  const Json expectations = read_json(fixture)["config"]["expected_file"];
  for (const auto& [name, file] : expectations.items()) {
    const std::size_t dot = name.find('.');
    const std::string folder = name.substr(0, dot), preference = dot == std::string::npos ? "" : name.substr(dot + 1);
    const auto chosen = dot == std::string::npos ? choose_decoder_checkpoint(root / folder, "final")
                                                 : choose_flow_checkpoint(root / folder, preference == "ema");
    EXPECT_EQ(chosen.filename().string(), file.get<std::string>()) << name;
    ++checked;
  }
  EXPECT_GT(checked, 0);
}

}  // namespace
}  // namespace anigen::io
