#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/table.h"
#include "anigen/nn/state_dict.h"
#include "anigen/skin_correction/network.h"
#include "anigen/train/export_run.h"
#include "tests/data/limb_dataset.h"
#include "tests/train/stages/run_folder.h"

namespace anigen::train {
namespace {

// Tubes whose vertices follow one bone each, which heat blends.
class SkinCorrectionTraining : public ::testing::Test {
 protected:
  SkinCorrectionTraining() {
    test::write_limb_dataset(folder_ / "data", 6);
    write_file_atomically(folder_ / "config.json", R"({
      "models": {"skin_correction": {"name": "SkinCorrection", "args": {
        "candidates": 6, "geovoxel_resolution": 32, "members": 2, "width": 32, "num_blocks": 1, "num_heads": 2}}},
      "dataset": {"name": "AniGenSkinCorrections", "args": {
        "candidates": 6, "geovoxel_resolution": 32, "cached_vertices": 0, "vertices": 32, "real_share": 0.5, "even_skeletons": true,
        "split": "splits/train.txt", "eval_split": "splits/test.txt"}},
      "trainer": {"name": "AniGenSkinCorrectionTrainer", "args": {
        "max_steps": 150, "batch_size": 4, "seed": 3, "ema_rate": [0.9], "fp16_mode": "none",
        "optimizer": {"name": "AdamW", "args": {"lr": 0.003}},
        "i_log": 50, "i_print": 0, "i_save": 150, "i_eval": 150, "i_sample": 0}}})");
  }

  std::vector<double> values(const std::string& column) const {
    const CsvTable metrics = read_csv(folder_ / "run/metrics.csv");
    std::vector<double> found;
    for (std::size_t row = 0; row < metrics.rows.size(); ++row) {
      if (!metrics.cell(row, column).empty()) found.push_back(std::stod(metrics.cell(row, column)));
    }
    return found;
  }
  double last(const std::string& column) const {
    const std::vector<double> all = values(column);
    return all.empty() ? -1.0 : all.back();
  }

  test::TemporaryFolder folder_;
};

TEST_F(SkinCorrectionTraining, BeatsHeatOnRigidLimbsAndItsRunIsExported) {
  train(test::train_command(folder_, "run"));
  for (const char* term : {"loss.kl", "loss.l1"}) {
    const std::vector<double> losses = values(term);
    ASSERT_EQ(losses.size(), 3U) << term;
    EXPECT_LT(losses.back(), 0.9 * losses.front()) << term;
  }
  EXPECT_GT(last("eval.heat_l1"), 0.1) << "heat blends what is rigid";
  EXPECT_LT(last("eval.l1"), 0.8 * last("eval.heat_l1"));
  EXPECT_LT(last("eval.l1"), 0.8 * last("eval.geovoxel_l1"));
  EXPECT_LT(last("eval.kl"), last("eval.heat_kl"));
  EXPECT_EQ(last("eval.missed"), 0.0);
  EXPECT_GE(last("eval.real_l1"), 0.0) << "a real rig and a creature are held out";

  const ExportedRun exported = export_run(folder_ / "run", folder_ / "out");
  EXPECT_EQ(exported.models, (std::vector<std::string>{"skin_correction"}));
  const auto loaded = [&](const std::filesystem::path& run) {
    return nn::load_trained<skin_correction::SkinCorrection>(
        nn::find_run_model(run, skin_correction::kSkinCorrectionClass), torch::kCPU);
  };
  skin_correction::SkinCorrection averaged = loaded(folder_ / "run"), half = loaded(folder_ / "out/run");
  const torch::Tensor pairs = torch::rand({9, 6, rigging::kSkinPairFeatures}) - 1.0;
  const torch::Tensor assets = torch::rand({9, rigging::kSkinAssetFeatures}),
                      present = torch::ones({9, 6}, torch::kBool);
  const torch::Tensor exact = averaged->forward(pairs, assets, present),
                      rounded = half->forward(pairs, assets, present);
  EXPECT_LT((exact.exp() - rounded.exp()).abs().max().item<double>(), 0.02);
}

TEST_F(SkinCorrectionTraining, ReplicasChangeNothingButLastBits) {
  train(test::train_command(folder_, "run",
                            {"trainer.args.max_steps=40", "trainer.args.i_eval=40", "trainer.args.batch_split=2"}));
  const double alone = last("eval.l1");
  std::filesystem::remove_all(folder_ / "run");
  train(test::train_command(folder_, "run",
                            {"trainer.args.max_steps=40", "trainer.args.i_eval=40", "trainer.args.batch_split=2",
                             "trainer.args.replicas=2"}));
  EXPECT_NEAR(last("eval.l1"), alone, 1e-3);
}

TEST_F(SkinCorrectionTraining, AConfigThatDoesNotFitIsRefused) {
  for (const char* wrong :
       {"models.skin_correction.args.candidates=5", "models.skin_correction.args.geovoxel_resolution=64",
        "models.skin_correction.args.feature_version=99", "dataset.name=AniGenMattings", "dataset.args.fold=7/5",
        "trainer.args.lambda_l1=-1", "trainer.args.feature_noise=-1", "models.skin_correction.args.members=0"})
    EXPECT_THROW(train(test::train_command(folder_, "wrong", {wrong})), InputError) << wrong;
}

}  // namespace
}  // namespace anigen::train
