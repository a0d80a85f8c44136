#include "anigen/train/export_run.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/train/trainer_state.h"
#include "tests/data/synthetic_dataset.h"
#include "tests/support/paths.h"
#include "tests/train/stages/run_folder.h"

namespace anigen::train {
namespace {

class ExportRun : public ::testing::Test {
 protected:
  ExportRun() {
    std::filesystem::create_directories(run() / "ckpts");
    write_file_atomically(run() / "config.json", R"({
      "models": {"denoiser": {"name": "Any", "args": {}}},
      "dataset": {"name": "Any", "args": {"data_dir": "/data/of/mine", "split": "/data/of/mine/few.txt", "eval_split": "splits/test.txt",
        "ss_dec_path": "/runs/of/mine/ss_dae/"}},
      "trainer": {"name": "Any", "args": {"image_encoder": {"estimator": "runs/picture_estimator"}}}})");
    write("denoiser_step0000010", 1.0F);
    write("denoiser_ema0.9_step0000010", 2.0F);
    write("image_encoder_step0000010", 3.0F);
  }

  std::filesystem::path run() const { return folder_ / "flow"; }

  void write(const std::string& name, float value) const {
    io::write_safetensors(run() / "ckpts" / (name + ".safetensors"),
                          {{"weight", io::NdArray::from(std::vector<float>{value, 0.1F, -7e-5F}, {3})},
                           {"rows", io::NdArray::from(std::vector<std::int64_t>{70000, 2}, {2})}});
  }

  test::TemporaryFolder folder_;
};

TEST_F(ExportRun, WritesAveragedWeightsInHalfPrecisionAndNoPaths) {
  const ExportedRun exported = export_run(run(), folder_ / "out");
  EXPECT_EQ(exported.models, (std::vector<std::string>{"denoiser", "image_encoder"}));
  EXPECT_EQ(exported.step, 10);
  EXPECT_EQ(exported.parameters, 10u);
  const auto arrays = io::read_state_dict(folder_ / "out/flow/ckpts/denoiser_step0000010.safetensors");
  const io::NdArray& weight = *io::find(arrays, "weight");
  EXPECT_EQ(weight.dtype, io::Dtype::kF16);
  EXPECT_EQ(weight.as<float>()[0], 2.0F) << "the average, not the weights";
  EXPECT_NEAR(weight.as<float>()[2], -7e-5F, 7e-5F / 1000) << "half a unit in the last place of eleven bits";
  EXPECT_EQ(io::find(arrays, "rows")->as<std::int64_t>()[0], 70000);
  const Json config = read_json(folder_ / "out/flow/config.json");
  EXPECT_EQ(config["dataset"]["args"],
            (Json{{"split", "splits/few.txt"}, {"eval_split", "splits/test.txt"}, {"ss_dec_path", "ss_dae"}}));
  EXPECT_EQ(config["trainer"]["args"]["image_encoder"]["estimator"], "picture_estimator");
}

TEST_F(ExportRun, EightBitsAreReadAsNumbersByWhoeverReadsWeights) {
  std::vector<float> values;
  for (int i = 0; i < 2048; ++i) values.push_back(std::cos(static_cast<float>(i)));
  io::write_safetensors(run() / "ckpts/denoiser_ema0.9_step0000010.safetensors",
                        {{"weight", io::NdArray::from(values, {32, 64})}});
  const ExportedRun exported = export_run(run(), folder_ / "out", ExportPrecision::kInt8);
  EXPECT_EQ(exported.parameters, 2048u + 5u);
  const auto file = folder_ / "out/flow/ckpts/denoiser_step0000010.safetensors";
  EXPECT_LT(std::filesystem::file_size(file), 2048u + 32u * 4u + 400u);
  const auto arrays = io::read_state_dict(file);
  ASSERT_EQ(arrays.size(), 1u);
  EXPECT_EQ(arrays[0].second.dtype, io::Dtype::kF32);
  EXPECT_NEAR(arrays[0].second.as<float>()[5], values[5], 0.5F / 127.0F);
}

TEST_F(ExportRun, RefusesItsOwnFolderAndNumbersThatHalfPrecisionLacks) {
  EXPECT_THROW(export_run(run(), folder_.path()), InputError);
  write("denoiser_ema0.9_step0000010", 1e6F);
  EXPECT_THROW(export_run(run(), folder_ / "out"), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out")) << "nothing half written";
}

constexpr char kSmallTraining[] = R"({
  "models": {"model": {"name": "SkinAutoEncoder", "args": {
    "encoder_config": {"skin_feat_channels": 4, "skl_pos_embed_freq": 6, "jp_embed_dim": 16,
                       "jp_embedder_config": {"hidden_dim": 16, "depth": 1, "jp_embed_attn": true}},
    "decoder_config": {"model_type": "tree", "skin_feat_channels": 4, "model_channels": 16, "num_blocks": 2}}}},
  "dataset": {"name": "AniGenSparseFeat2Skeleton", "args": {"test_mode": false, "eval_fraction": 0.2}},
  "trainer": {"name": "AniGenSkinAETrainer", "args": {
    "max_steps": 2, "batch_size": 4, "batch_split": 2, "num_skin_samples": 32, "seed": 5,
    "optimizer": {"name": "AdamW", "args": {"lr": 0.003}}, "ema_rate": [0.9], "fp16_mode": "none", "i_log": 1,
    "i_print": 0, "i_save": 2, "i_eval": 0, "i_sample": 0}}})";

TEST(ExportedWeights, AreAStartForTraining) {
  const test::TemporaryFolder folder;
  test::write_synthetic_dataset(folder / "data", 10);
  write_file_atomically(folder / "config.json", kSmallTraining);
  train(test::train_command(folder, "first"));
  export_run(folder / "first", folder / "exported");
  TrainCommand from = test::train_command(folder, "second", {"trainer.args.max_steps=0"});
  from.run.load = folder / "exported/first";
  train(from);
  const auto start = CheckpointFolder(folder / "second/ckpts").weights("model", 0);
  for (const auto& [name, array] : CheckpointFolder(folder / "exported/first/ckpts").weights("model", 2)) {
    const io::NdArray* found = io::find(start, name);
    ASSERT_NE(found, nullptr) << name;
    EXPECT_EQ(found->as<float>(), array.as<float>()) << name;
  }
  from.run.ckpt = "2";
  from.run.output = folder / "third";
  EXPECT_THROW(train(from), InputError) << "there is no state of step 2";
}

}  // namespace
}  // namespace anigen::train
