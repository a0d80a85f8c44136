#include "anigen/train/stages/stages.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/state_dict.h"
#include "anigen/sparse_structure/autoencoder.h"
#include "tests/train/stages/flow_configs.h"
#include "tests/train/stages/flow_run.h"

namespace anigen::train {
namespace {

using torch::Tensor;

class StructureFlow : public test::FlowRun {
 protected:
  StructureFlow() : FlowRun(test::kStructureFlowConfig) {}

  // A run of stage 2 with random weights: ss_run.
  void write_decoder() const {
    const Json decoder = {{"latent_channels", 8},       {"latent_channels_skl", 4},    {"num_res_blocks", 1},
                          {"num_res_blocks_middle", 1}, {"channels", {4, 4, 4}},       {"encode_global", false},
                          {"encode_global_skl", false}, {"use_pretrain_branch", false}};
    Json run;
    run["models"]["decoder"] = {{"name", "AniGenSparseStructureDecoder"}, {"args", decoder}};
    write_file_atomically(folder_ / "ss_run/config.json", run.dump());
    sparse_structure::SparseStructureDecoder model(sparse_structure::SparseStructureDecoderOptions::from_json(decoder));
    io::write_safetensors(folder_ / "ss_run/ckpts/decoder_step0000001.safetensors", nn::state_dict(*model));
  }
};

TEST_F(StructureFlow, DrawsDependOnSeedStepAndMicroBatchAlone) { expect_draws_named_by_seed_step_and_micro_batch(); }

TEST_F(StructureFlow, TheLossIsTheSumOfBothStreamsAndOfItsTimeBins) {
  const auto flow = stage();
  const auto batch = flow->data().load({data::Draw{0, 0}});
  const Losses losses = flow->losses(*batch, {5, 0, 0});
  ASSERT_EQ(losses.terms.size(), 4u) << "one item lies in one tenth of the time axis";
  const auto value = [&](std::size_t i) { return losses.terms[i].second.item<double>(); };
  EXPECT_EQ(losses.terms[0].first, "mse");
  EXPECT_EQ(losses.terms[1].first, "mse_skl");
  EXPECT_NEAR(total_loss(losses), value(0) + value(1), 1e-6 * total_loss(losses));
  EXPECT_EQ(losses.terms[2].first.rfind("bin_", 0), 0u);
  EXPECT_NEAR(value(2), value(0), 1e-6 * value(0));
  EXPECT_NEAR(value(3), value(1), 1e-6 * value(1));
}

TEST_F(StructureFlow, GeometryAloneIsJudgedByItsShape) {
  const std::vector<std::string> alone = {"models.denoiser.args.geometry_only=true"};
  const auto flow = stage(alone);
  const auto batch = flow->data().load({data::Draw{0, 0}});
  const Losses losses = flow->losses(*batch, {5, 0, 0});
  ASSERT_EQ(losses.terms.size(), 2u) << "the shape and its tenth of the time axis";
  EXPECT_EQ(losses.terms[0].first, "mse");
  EXPECT_EQ(total_loss(losses), losses.terms[0].second.item<double>());
  ASSERT_EQ(flow->evaluate().size(), 1u);
  EXPECT_EQ(flow->evaluate().front().first, "mse");
  write_decoder();
  train(command("run", {alone[0], "trainer.args.max_steps=2", "trainer.args.i_sample=100",
                        "dataset.args.ss_dec_path=" + (folder_ / "ss_run").string(), "trainer.args.lambda_dice=1",
                        "trainer.args.dice_time=0"}));
  sample_sheet("run", 2);
  EXPECT_NE(message({alone[0], "trainer.args.p_given_shape=1"}).find("p_given_shape"), std::string::npos);
}

TEST_F(StructureFlow, DroppedConditionsDoNotSeeThePicture) {
  const auto batch = batch_of(*stage());
  expect_dropped_conditions_not_to_see_the_picture(*batch, dynamic_cast<data::StructureLatentBatch&>(*batch).cond);
}

TEST_F(StructureFlow, NormalsCanBeTheCondition) {
  for (int i = 0; i < test::PublishedSample::kAssets; ++i) {
    for (const char* name : {"000_normal.png", "001_normal.png"})
      io::write_png(sample_.condition(i) / name, test::PublishedSample::picture(127, 127, 255));
  }
  const std::string all = "trainer.args.p_uncond=0";
  const auto color = stage({all}), normal = stage({all, "dataset.args.condition=normal"});
  const auto batch = batch_of(*normal);
  const Tensor pictures = dynamic_cast<const data::StructureLatentBatch&>(*batch).cond;
  EXPECT_GT(pictures.select(1, 2).max().item<float>(), 0.9f) << "a surface that looks at the camera is blue";
  EXPECT_LT(pictures.select(1, 0).max().item<float>(), 0.7f) << "127 of 255, and what Lanczos overshoots at an edge";
  const double loss = total_loss(normal->losses(*batch, {5, 0, 0}));
  EXPECT_TRUE(std::isfinite(loss));
  EXPECT_NE(loss, total_loss(color->losses(*batch_of(*color), {5, 0, 0})));
}

TEST_F(StructureFlow, DiceOfDecodedVoxelsCanBePartOfTheLoss) {
  EXPECT_THROW(stage({"trainer.args.lambda_dice=0.5"}), InputError) << "no decoder";
  write_decoder();
  const std::string decoder = "dataset.args.ss_dec_path=" + (folder_ / "ss_run").string();
  const auto dice_of = [&](const std::string& more) {
    const auto flow = stage({"trainer.args.lambda_dice=0.5", "trainer.args.i_sample=100", decoder, more});
    const Losses losses = flow->losses(*flow->data().load({data::Draw{0, 0}, data::Draw{1, 1}}), {5, 3, 0});
    for (const auto& [name, value] : losses.terms) {
      if (name != "dice") continue;
      const double whole = losses.terms[0].second.item<double>() + losses.terms[1].second.item<double>();
      EXPECT_NEAR(total_loss(losses), whole + 0.5 * value.item<double>(), 1e-5 * whole);
      return value.item<double>();
    }
    return -1.0;
  };
  const double dice = dice_of("trainer.args.dice_time=0");
  EXPECT_GT(dice, 0.0);
  EXPECT_LE(dice, 2.0) << "1 for each stream";
  EXPECT_EQ(dice_of("trainer.args.dice_time=1"), -1.0) << "no item is so late";
  EXPECT_EQ(dice_of("trainer.args.dice_from_step=4"), -1.0);
}

TEST_F(StructureFlow, GivenShapesAreSeenCleanAndCountForNothing) {
  const auto flow = stage({"trainer.args.p_given_shape=1"});
  const auto batch = batch_of(*flow);
  auto& latents = dynamic_cast<data::StructureLatentBatch&>(*batch);
  const Losses losses = flow->losses(*batch, {5, 0, 0});
  EXPECT_EQ(term(losses, "mse"), 0.0);
  EXPECT_GT(term(losses, "mse_skl"), 0.0);
  EXPECT_EQ(total_loss(losses), term(losses, "mse_skl"));
  EXPECT_EQ(flow->evaluate().front().second, 0.0) << "held-out shapes are given, too";
  // Noise and times are those of a run without, so that only what is seen of the shape differs.
  const auto noisy = stage();
  const Losses without = noisy->losses(*batch, {5, 0, 0});
  EXPECT_GT(term(without, "mse"), 0.0);
  EXPECT_NE(term(without, "mse_skl"), term(losses, "mse_skl"));
  latents.x_0 = latents.x_0 + 1.0;
  EXPECT_NE(term(flow->losses(*batch, {5, 0, 0}), "mse_skl"), term(losses, "mse_skl")) << "the shape decides";
}

TEST_F(StructureFlow, SomeShapesCanBeGiven) {
  const auto some = stage({"trainer.args.p_given_shape=0.5"});
  const auto batch = batch_of(*some);
  bool differs = false, whole = false;
  for (std::uint64_t step = 0; step < 16; ++step) {
    const double mse = term(some->losses(*batch, {step, 0, 0}), "mse"),
                 all = term(stage()->losses(*batch, {step, 0, 0}), "mse");
    EXPECT_LE(mse, all * (1.0 + 1e-6));
    differs = differs || mse < all * (1.0 - 1e-6);
    whole = whole || std::abs(mse - all) <= 1e-6 * all;
  }
  EXPECT_TRUE(differs && whole) << "of two items none, one or both are given";
}

TEST_F(StructureFlow, EvaluationRepeatsItself) {
  const auto flow = stage();
  const Values first = flow->evaluate();
  ASSERT_EQ(first.size(), 2u);
  EXPECT_EQ(first[0].first, "mse");
  EXPECT_EQ(first[1].first, "mse_skl");
  EXPECT_EQ(flow->evaluate(), first);
  EXPECT_GT(first[0].second, 0.1);
}

TEST_F(StructureFlow, ReplicasHaveTheSameFrozenWeights) {
  expect_frozen_branches_to_start_warm("AniGenSparseStructureFlowModel");
}

TEST_F(StructureFlow, LearnsAndLogs) {
  expect_falling_loss(
      {"loss.total", "loss.mse", "loss.mse_skl", "loss.bin_7.mse", "loss.bin_7.mse_skl", "eval.mse", "eval.mse_skl"});
}

TEST_F(StructureFlow, ResumedRunsEndWithTheSameBits) { expect_same_bits_after_resuming(); }

TEST_F(StructureFlow, SixteenBitBlocksComeCloseAndKeepFullPrecisionMasters) { expect_close_bf16_with_full_masters(); }

TEST_F(StructureFlow, SeveralRanksTrainAlike) { expect_the_same_on_several_ranks(); }

TEST_F(StructureFlow, WithoutPicturesItLearnsTheDistribution) {
  const std::vector<std::string> overrides{
      "trainer.name=AniGenFlowMatchingTrainer",
      R"(dataset={"name": "AniGenSparseStructureLatent", "args": {"latent_model": "ss"}})"};
  Json config = parse_json(test::kStructureFlowConfig, "test");
  config["trainer"]["args"].erase("image_encoder");
  config["trainer"]["args"]["i_eval"] = 0;
  write_file_atomically(folder_ / "config.json", config.dump());
  train(command("run", overrides));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "run/ckpts/denoiser_step0000012.safetensors"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "run/ckpts/image_encoder_step0000012.safetensors"));
}

TEST_F(StructureFlow, SamplesBecomeASheetAndATensorBoardPicture) {
  write_decoder();
  train(command("run", {"trainer.args.max_steps=2", "trainer.args.i_sample=100",
                        "dataset.args.ss_dec_path=" + (folder_ / "ss_run").string()}));
  EXPECT_GT(sample_sheet("run", 2).width, 4 * 192) << "picture, guided, not guided, truth";
  EXPECT_THROW(train(command("bad", {"trainer.args.i_sample=1", "dataset.args.ss_dec_path=nowhere"})), InputError);
}

TEST_F(StructureFlow, BadConfigsNameTheKey) {
  EXPECT_NE(message({"dataset.args.image_size=16"}).find("image_size"), std::string::npos);
  EXPECT_NE(message({"trainer.args.image_encoder={\"name\": \"dinov2\"}"}).find("weights"), std::string::npos);
  EXPECT_NE(message({"trainer.args.image_encoder.nme=1"}).find("nme"), std::string::npos);
  EXPECT_NE(message({"trainer.args.p_uncnd=1"}).find("p_uncond"), std::string::npos);
  EXPECT_NE(message({"trainer.args.p_given_shape=1.5"}).find("p_given_shape"), std::string::npos);
  EXPECT_NE(message({"trainer.args.sampler.sigma_min=0.001"}).find("sigma_min"), std::string::npos);
  EXPECT_NE(message({"trainer.args.sampler.steps=null"}).find("steps"), std::string::npos);
  EXPECT_NE(message({"trainer.args.train_inpaint=true"}).find("not supported"), std::string::npos);
  EXPECT_NE(message({"trainer.name=AniGenFlowMatchingTrainer"}).find("AniGenSparseStructureLatent"), std::string::npos);
  EXPECT_NE(message({"trainer.name=Other"}).find("AniGenSparseStructureVaeTrainer"), std::string::npos);
  EXPECT_NE(message({"models.denoiser.args.num_blcks=1"}).find("num_blocks"), std::string::npos);
}

}  // namespace
}  // namespace anigen::train
