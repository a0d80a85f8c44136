#include "anigen/train/stages/stages.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/state_dict.h"
#include "anigen/structured_latent/decoder.h"
#include "anigen/train/stage.h"
#include "tests/train/stages/flow_configs.h"
#include "tests/train/stages/flow_run.h"
#include "tests/train/stages/structured_latent_dataset.h"

namespace anigen::train {
namespace {

using torch::Tensor;

const std::vector<std::string> kJointCounts = {"models.denoiser.args.use_joint_num_cond=true",
                                               "dataset.args.use_joint_num_cond=true",
                                               "trainer.args.use_joint_num_cond=true"};

std::vector<std::string> with(std::vector<std::string> overrides, const std::vector<std::string>& more) {
  overrides.insert(overrides.end(), more.begin(), more.end());
  return overrides;
}

class LatentFlow : public test::FlowRun {
 protected:
  LatentFlow() : FlowRun(test::kLatentFlowConfig) {
    for (int i = 0; i < test::PublishedSample::kAssets; ++i) io::write_npz(sample_.latent(i), test::box_latents(i));
  }

  static data::StructuredLatentBatch& latents_in(data::Batch& batch) {
    return dynamic_cast<data::StructuredLatentBatch&>(batch);
  }

  // A run of stage 3 with fresh weights, which draw the outline of the voxels.
  std::string decoder_run(const Json& trainer_args = Json::object()) {
    Json run;
    run["models"] = test::post_models();
    run["trainer"] = {{"name", "AniGenSLatVaeSkeletonTrainer"}, {"args", trainer_args}};
    const auto folder = folder_ / "slat_run";
    write_file_atomically(folder / "config.json", run.dump());
    torch::manual_seed(3);
    structured_latent::StructuredLatentDecoder decoder(
        structured_latent::StructuredLatentDecoderOptions::from_json(run["models"]["decoder"]["args"]));
    io::write_safetensors(folder / "ckpts/decoder_step0000001.safetensors", nn::state_dict(*decoder));
    return "dataset.args.slat_dec_path=" + folder.string();
  }
};

TEST_F(LatentFlow, DrawsDependOnSeedStepAndMicroBatchAlone) { expect_draws_named_by_seed_step_and_micro_batch(); }

TEST_F(LatentFlow, DrawsComeInThePublishedOrder) {
  // A fresh flow answers zero, so that its loss is the mean square of the target (1 − σ) ε − x₀ over all voxels.
  const auto flow = fresh_stage();
  const auto batch = batch_of(*flow);
  const Losses losses = flow->losses(*batch, {5, 3, 1});
  const data::StructuredLatentBatch& latents = latents_in(*batch);
  const at::Generator generator = loss_generator({5, 3, 1}, "structured-latent flow");
  const Tensor noise = torch::randn(latents.x_0.feats.sizes(), generator);
  torch::randn({2}, generator);  // times
  const Tensor noise_skl = torch::randn(latents.x_0_skl.feats.sizes(), generator);
  const Tensor target = (1.0 - 1e-5) * noise - latents.x_0.feats,
               target_skl = (1.0 - 1e-5) * noise_skl - latents.x_0_skl.feats;
  EXPECT_NEAR(term(losses, "mse"), target.square().mean().item<double>(), 1e-5);
  EXPECT_NEAR(term(losses, "mse_geo"), target.slice(1, 0, 8).square().mean().item<double>(), 1e-5);
  EXPECT_NEAR(term(losses, "mse_skin"), target.slice(1, 8).square().mean().item<double>(), 1e-5);
  EXPECT_NEAR(term(losses, "mse_skl"), target_skl.square().mean().item<double>(), 1e-5);
}

TEST_F(LatentFlow, TheLossIsTheSumOfItsMeansAndOfItsTimeBins) {
  const auto flow = stage();
  const auto batch = flow->data().load({data::Draw{0, 0}});
  const Losses losses = flow->losses(*batch, {5, 0, 0});
  ASSERT_EQ(losses.terms.size(), 6u) << "one item lies in one tenth of the time axis";
  const double mse = term(losses, "mse"), mse_skl = term(losses, "mse_skl");
  EXPECT_NEAR(total_loss(losses), mse + mse_skl, 1e-6 * total_loss(losses));
  EXPECT_NEAR(mse, 0.5 * (term(losses, "mse_geo") + term(losses, "mse_skin")), 1e-6 * mse);
  EXPECT_EQ(losses.terms[4].first.rfind("bin_", 0), 0u);
  EXPECT_NEAR(losses.terms[4].second.item<double>(), mse, 1e-5 * mse);
  EXPECT_NEAR(losses.terms[5].second.item<double>(), mse_skl, 1e-5 * mse_skl);
}

TEST_F(LatentFlow, RigFieldsOfDecodedLatentsCanBePartOfTheLoss) {
  const std::vector<std::string> weights{"trainer.args.lambda_votes=0.5", "trainer.args.lambda_rig_features=0.25"};
  EXPECT_THROW(stage({weights[0]}), InputError) << "no decoder";
  EXPECT_THROW(stage({weights[1]}), InputError) << "no decoder";
  const std::vector<std::string> decoder{decoder_run(), "trainer.args.i_sample=100"};
  const auto losses_from = [&](const std::string& more) {
    const auto flow = stage(with(with(weights, decoder), {more}));
    return flow->losses(*flow->data().load({data::Draw{0, 0}, data::Draw{1, 1}}), {5, 3, 0});
  };
  const Losses losses = losses_from("trainer.args.rig_time=0");
  const double latents = term(losses, "mse") + term(losses, "mse_skl");
  EXPECT_GT(term(losses, "votes"), 0.0);
  EXPECT_GT(term(losses, "rig_features"), 0.0);
  const double whole = latents + 0.5 * term(losses, "votes") + 0.25 * term(losses, "rig_features");
  EXPECT_NEAR(total_loss(losses), whole, 1e-5 * whole);
  const Losses early = losses_from("trainer.args.rig_time=1");
  EXPECT_NEAR(total_loss(early), term(early, "mse") + term(early, "mse_skl"), 1e-5 * latents) << "no item is so late";
}

TEST_F(LatentFlow, DroppedConditionsDoNotSeeThePicture) {
  const auto batch = batch_of(*stage());
  expect_dropped_conditions_not_to_see_the_picture(*batch, latents_in(*batch).cond);
}

TEST_F(LatentFlow, JointCountsAreDroppedApartFromPictures) {
  const std::vector<std::string> half = with(kJointCounts, {"trainer.args.p_uncond=0.5"});
  const auto told = stage(with(half, {"trainer.args.p_uncond_joint_num=0"})),
             untold = stage(with(half, {"trainer.args.p_uncond_joint_num=1"}));
  const auto batch = batch_of(*told);
  EXPECT_TRUE(torch::equal(latents_in(*batch).joints_num, torch::tensor({2, 2}, torch::kInt64)));
  const Losses with_two = told->losses(*batch, {5, 0, 0}), without = untold->losses(*batch, {5, 0, 0});
  latents_in(*batch).joints_num.fill_(40);
  const Losses with_forty = told->losses(*batch, {5, 0, 0});
  for (const char* name : {"mse_skin", "mse_skl"}) {
    EXPECT_NE(term(with_two, name), term(with_forty, name));
    EXPECT_NE(term(with_two, name), term(without, name));
    EXPECT_EQ(term(without, name), term(untold->losses(*batch, {5, 0, 0}), name));
  }
  // The geometry never hears of them, so that it shows whether noise, times and dropped pictures stayed the same.
  EXPECT_EQ(term(with_two, "mse_geo"), term(with_forty, "mse_geo"));
  EXPECT_EQ(term(with_two, "mse_geo"), term(without, "mse_geo"));
}

TEST_F(LatentFlow, SmoothNoiseIsTheSkinsAlone) {
  const auto rough = stage(),
             smooth = stage({"trainer.args.geodesic_smooth_noise=true", "trainer.args.geodesic_smooth_noise_iters=4"});
  const auto batch = batch_of(*rough);
  const Losses a = rough->losses(*batch, {5, 0, 0}), b = smooth->losses(*batch, {5, 0, 0});
  EXPECT_EQ(term(a, "mse_geo"), term(b, "mse_geo"));
  EXPECT_NE(term(a, "mse_skin"), term(b, "mse_skin"));
  EXPECT_NE(rough->evaluate(), smooth->evaluate());
}

TEST_F(LatentFlow, EvaluationRepeatsItself) {
  const auto flow = stage(kJointCounts);
  const Values first = flow->evaluate();
  ASSERT_EQ(first.size(), 4u);
  const char* names[] = {"mse", "mse_geo", "mse_skin", "mse_skl"};
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].first, names[i]);
    EXPECT_GT(first[i].second, 0.1);
  }
  EXPECT_NEAR(first[0].second, 0.5 * (first[1].second + first[2].second), 1e-5 * first[0].second);
  EXPECT_EQ(flow->evaluate(), first);
}

TEST_F(LatentFlow, ReplicasHaveTheSameFrozenWeights) { expect_frozen_branches_to_start_warm("AniGenSlatFlowImage"); }

TEST_F(LatentFlow, LearnsAndLogs) {
  expect_falling_loss({"loss.total", "loss.mse", "loss.mse_skl", "loss.mse_geo", "loss.mse_skin", "loss.bin_7.mse",
                       "loss.bin_7.mse_skl", "eval.mse", "eval.mse_geo", "eval.mse_skin", "eval.mse_skl"});
}

TEST_F(LatentFlow, ResumedRunsEndWithTheSameBits) {
  expect_same_bits_after_resuming(with(kJointCounts, {"dataset.args.bucket_by_voxels=true"}));
}

TEST_F(LatentFlow, SixteenBitBlocksComeCloseAndKeepFullPrecisionMasters) { expect_close_bf16_with_full_masters(); }

TEST_F(LatentFlow, SeveralRanksTrainAlike) { expect_the_same_on_several_ranks(); }

TEST_F(LatentFlow, WithoutPicturesItLearnsTheDistribution) {
  Json config = parse_json(test::kLatentFlowConfig, "test");
  config["trainer"]["args"].erase("image_encoder");
  config["trainer"]["name"] = "AniGenSparseFlowMatchingTrainer";
  config["dataset"]["name"] = "AniGenSLat";
  config["dataset"]["args"].erase("image_size");
  write_file_atomically(folder_ / "config.json", config.dump());
  train(command("run"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "run/ckpts/denoiser_step0000012.safetensors"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "run/ckpts/image_encoder_step0000012.safetensors"));
}

TEST_F(LatentFlow, SamplesBecomeASheetAndATensorBoardPicture) {
  const std::vector<std::string> drawn = {"trainer.args.max_steps=2", "trainer.args.i_sample=100"};
  train(command("run", with(with(drawn, kJointCounts), {decoder_run({{"skin_ae", "joint"}})})));
  const io::Image sheet = sample_sheet("run", 2);
  EXPECT_GT(sheet.width, 6 * 256) << "picture, sample and its weights, latents and their weights, asset";
  // Each of the four decoded tiles shows something on its background.
  for (int tile = 1; tile <= 4; ++tile) {
    const int left = 12 + tile * (256 + 12);
    bool drawn_on = false;
    for (int x = left; x < left + 256; ++x)
      drawn_on = drawn_on || sheet.pixel(x, 12 + 128)[0] != sheet.pixel(left + 4, 12 + 4)[0];
    EXPECT_TRUE(drawn_on) << "tile " << tile;
  }
  EXPECT_THROW(train(command("bad", with(drawn, {"dataset.args.slat_dec_path=nowhere"}))), InputError);
  EXPECT_THROW(train(command("bad", with(drawn, {decoder_run({{"geometry_only", true}})}))), InputError);
}

// With the auto-encoder of the shape alone, too, which a flow of whole rigs refuses.
TEST_F(LatentFlow, GeometryAloneIsJudgedAndShownByItsShape) {
  const std::string alone = "models.denoiser.args.geometry_only=true";
  const auto flow = stage({alone});
  const Losses losses = flow->losses(*batch_of(*flow), {5, 0, 0});
  EXPECT_EQ(losses.terms.front().first, "mse_geo");
  EXPECT_EQ(total_loss(losses), term(losses, "mse_geo"));
  for (const auto& [name, value] : losses.terms) EXPECT_EQ(name.find("sk"), std::string::npos) << name;
  ASSERT_EQ(flow->evaluate().size(), 1u);
  EXPECT_EQ(flow->evaluate().front().first, "mse_geo");
  train(command(
      "run", {alone, "trainer.args.max_steps=2", "trainer.args.i_sample=100", decoder_run({{"geometry_only", true}})}));
  EXPECT_GT(sample_sheet("run", 2).width, 6 * 256);
  EXPECT_NE(message({alone, "trainer.args.lambda_votes=1"}).find("lambda_votes"), std::string::npos);
}

TEST_F(LatentFlow, BadConfigsNameTheKey) {
  const auto names = [&](const std::vector<std::string>& overrides, const std::string& word) {
    const std::string found = message(overrides);
    EXPECT_NE(found.find(word), std::string::npos) << found;
  };
  names({"dataset.args.image_size=16"}, "image_size");
  names({"trainer.args.p_uncond_joint_num=2"}, "p_uncond_joint_num");
  names({"trainer.args.geodesic_smooth_noise_alpha=-1"}, "geodesic_smooth_noise_alpha");
  names({"trainer.args.train_inpaint=true"}, "not supported");
  names({"trainer.args.use_joint_num_cond=true"}, "model's use_joint_num_cond");
  names({kJointCounts[0], kJointCounts[2]}, "dataset's use_joint_num_cond");
  names({"models.denoiser.args.in_channels=7", "models.denoiser.args.out_channels=7"}, "latents have 16");
  names({"models.denoiser.args.in_channels_skl=5", "models.denoiser.args.out_channels_skl=5"}, "latents have 4");
  names({"models.denoiser.args.out_channels_vert_skin=7"}, "out_channels_vert_skin");
  names({"models.denoiser.name=AniGenSparseStructureFlowModel"}, "AniGenElasticSLatFlowModel");
  names({"models.denoiser.args.num_blcks=1"}, "num_blocks");
  names({"trainer.name=AniGenSparseFlowMatchingCFGTrainer"}, "AniGenSLat");
  names({"dataset.args.latent_model=other"}, "latent_other");
  names({"dataset.args.load_rgs=false"}, "load_rigs");
  const std::string fitting = decoder_run({{"skin_ae", "joint"}});
  names({fitting, "trainer.args.i_sample=1", "dataset.args.slat_dec_ckpt=final_7"}, "final_7");
  Json run = read_json(folder_ / "slat_run/config.json");
  run["models"]["decoder"]["args"]["latent_channels_skl"] = 3;
  write_file_atomically(folder_ / "slat_run/config.json", run.dump());
  structured_latent::StructuredLatentDecoder other(
      structured_latent::StructuredLatentDecoderOptions::from_json(run["models"]["decoder"]["args"]));
  io::write_safetensors(folder_ / "slat_run/ckpts/decoder_step0000001.safetensors", nn::state_dict(*other));
  names({fitting, "trainer.args.i_sample=1"}, "latent_channels_skl");
}

TEST_F(LatentFlow, BothNamesOfTheModelTrain) {
  EXPECT_EQ(message({"models.denoiser.name=AniGenSLatFlowModel"}), "no error");
}

}  // namespace
}  // namespace anigen::train
