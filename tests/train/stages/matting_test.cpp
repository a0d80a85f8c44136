#include "anigen/vision/matting.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/table.h"
#include "anigen/nn/state_dict.h"
#include "anigen/train/export_run.h"
#include "tests/data/disc_dataset.h"
#include "tests/train/stages/run_folder.h"

namespace anigen::train {
namespace {

using torch::Tensor;

// Discs before drawn backgrounds.
class MattingTraining : public ::testing::Test {
 protected:
  MattingTraining() {
    test::write_disc_dataset(folder_ / "data", 4);
    write_file_atomically(folder_ / "config.json", R"({
      "models": {"matting": {"name": "MattingUNet", "args": {
        "image_size": 32, "width": 64, "num_blocks": 1, "num_heads": 2}}},
      "dataset": {"name": "AniGenMattings", "args": {"image_size": 32, "eval_split": "splits/test.txt"}},
      "trainer": {"name": "AniGenMattingTrainer", "args": {
        "max_steps": 60, "batch_size": 4, "seed": 3, "ema_rate": [0.9], "fp16_mode": "none",
        "optimizer": {"name": "AdamW", "args": {"lr": 0.003}},
        "i_log": 20, "i_print": 0, "i_save": 60, "i_eval": 60, "i_sample": 0}}})");
  }

  std::vector<double> values(const char* column) const {
    const CsvTable metrics = read_csv(folder_ / "run/metrics.csv");
    std::vector<double> found;
    for (std::size_t row = 0; row < metrics.rows.size(); ++row) {
      if (!metrics.cell(row, column).empty()) found.push_back(std::stod(metrics.cell(row, column)));
    }
    return found;
  }

  test::TemporaryFolder folder_;
};

TEST_F(MattingTraining, LearnsAndItsRunIsExported) {
  const std::filesystem::path cutouts = folder_ / "cutouts";
  std::filesystem::create_directories(cutouts);
  io::write_png(cutouts / "disc.png", test::disc_cutout(64, 0xB060E0));
  train(test::train_command(folder_, "run", {"dataset.args.pictures=" + cutouts.string()}));
  for (const char* term : {"loss.bce", "loss.l1", "loss.dice"}) {
    const std::vector<double> losses = values(term);
    ASSERT_EQ(losses.size(), 3U) << term;
    EXPECT_LT(losses.back(), 0.9 * losses.front()) << term;
  }
  ASSERT_EQ(values("eval.iou").size(), 1U);
  EXPECT_GT(values("eval.iou").front(), 0.0);
  EXPECT_LE(values("eval.iou").front(), 1.0);
  EXPECT_LT(values("eval.mae").front(), 0.5) << "what knows nothing has ½";

  const ExportedRun exported = export_run(folder_ / "run", folder_ / "out");
  EXPECT_EQ(exported.models, (std::vector<std::string>{"matting"}));
  EXPECT_EQ(exported.step, 60);
  EXPECT_EQ(read_json(folder_ / "out/run/config.json")["dataset"]["args"]["pictures"], "cutouts");
  const auto loaded = [&](const std::filesystem::path& run) {
    return nn::load_trained<vision::MattingUNet>(nn::find_run_model(run, vision::kMattingUNetClass), torch::kCPU);
  };
  vision::MattingUNet averaged = loaded(folder_ / "run"), half = loaded(folder_ / "out/run");
  const Tensor pictures = torch::rand({2, 3, 32, 32});
  const Tensor exact = averaged->forward(pictures), rounded = half->forward(pictures);
  EXPECT_FALSE(torch::equal(exact, rounded));
  EXPECT_LT((exact.sigmoid() - rounded.sigmoid()).abs().max().item<double>(), 0.05);
}

TEST_F(MattingTraining, AConfigThatDoesNotFitIsRefused) {
  for (const char* wrong :
       {"models.matting.args.image_size=48", "models.matting.args.width=60", "dataset.name=AniGenPictures",
        "dataset.args.pictures=nowhere", "trainer.args.lambda_dice=-1"})
    EXPECT_THROW(train(test::train_command(folder_, "wrong", {wrong})), InputError) << wrong;
}

}  // namespace
}  // namespace anigen::train
