#include "anigen/train/sparse_structure_flow_stage.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "anigen/core/atomic_file.h"
#include "anigen/core/config_file.h"
#include "anigen/core/csv.h"
#include "anigen/core/error.h"
#include "anigen/io/image.h"
#include "anigen/io/safetensors.h"
#include "anigen/models/state_dict.h"
#include "anigen/train/stages.h"
#include "anigen/train/train_command.h"
#include "tests/loaders/published_sample.h"

namespace anigen::train {
namespace {

using torch::Tensor;

constexpr char kFlowConfig[] = R"({
  "models": {"denoiser": {"name": "AniGenSparseStructureFlowModel", "args": {
    "resolution": 2, "in_channels": 8, "in_channels_skl": 4, "out_channels": 8, "out_channels_skl": 4,
    "model_channels": 16, "model_channels_skl": 16, "cond_channels": 12, "num_blocks": 2, "num_heads": 2,
    "mlp_ratio": 2, "patch_size": 1, "qk_rms_norm": true, "use_pretrain_branch": false}}},
  "dataset": {"name": "ImageConditionedAniGenSparseStructureLatent", "args": {
    "latent_model": "ss", "image_size": 8, "eval_split": "held_out.txt"}},
  "trainer": {"name": "AniGenImageConditionedFlowMatchingCFGTrainer", "args": {
    "max_steps": 12, "batch_size": 4, "batch_split": 2, "seed": 5,
    "optimizer": {"name": "AdamW", "args": {"lr": 0.003}}, "ema_rate": [0.9], "fp16_mode": "none",
    "i_log": 4, "i_print": 0, "i_save": 4, "i_eval": 6, "i_sample": 0, "p_uncond": 0.25,
    "t_schedule": {"name": "logitNormal", "args": {"mean": 1.0, "std": 1.0}},
    "sampler": {"steps": 2}, "sample_assets": 1,
    "image_encoder": {"name": "patch", "image_size": 8, "patch_size": 4, "width": 16, "num_blocks": 1,
                      "num_heads": 2}}}})";

class StructureFlow : public ::testing::Test {
 protected:
  StructureFlow() {
    write_file_atomically(sample_.root() / "held_out.txt", test::PublishedSample::id(2) + "\n");
    write_file_atomically(folder_ / "config.json", kFlowConfig);
  }

  TrainCommand command(const std::string& output, std::vector<std::string> overrides = {}) {
    TrainCommand c;
    c.config = folder_ / "config.json";
    c.data_dir = sample_.root().string();
    c.run.output = folder_ / output;
    c.overrides = std::move(overrides);
    c.command_line = "anigen-train";
    return c;
  }

  /// A stage whose weights are all away from zero, where the published start has them: there every output is zero.
  std::unique_ptr<Stage> stage(const std::vector<std::string>& overrides = {}) {
    Json config = parse_json(kFlowConfig, "test");
    apply_overrides(config, overrides);
    config["dataset"]["args"]["data_dir"] = sample_.root().string();
    const Json trainer = config.at("trainer");
    ConfigReader args(trainer.at("args"), "test", "/trainer/args");
    const TrainerOptions options = TrainerOptions::read(args);
    auto made = make_stage(trainer.at("name").get<std::string>(), config, "test", args, options, torch::kCPU);
    args.finish();
    const torch::NoGradGuard no_grad;
    torch::manual_seed(11);
    for (const NamedModel& model : made->models()) {
      for (Tensor parameter : model.module->parameters()) parameter.normal_(0.0, 0.2);
    }
    return made;
  }

  static std::unique_ptr<loaders::Batch> batch_of(const Stage& stage) {
    return stage.data().load({loaders::Draw{0, 0}, loaders::Draw{1, 1}});
  }
  std::string bytes(const std::string& file) { return read_file(folder_ / file); }

  test::TemporaryFolder folder_;
  test::PublishedSample sample_{folder_ / "data"};
};

double total_loss(const Losses& losses) { return losses.total.item<double>(); }

TEST_F(StructureFlow, DrawsDependOnSeedStepAndMicroBatchAlone) {
  const auto one = stage(), two = stage();
  const auto batch = batch_of(*one);
  const double first = total_loss(one->losses(*batch, {5, 7, 1}));
  torch::manual_seed(123);
  torch::randn({100});
  EXPECT_EQ(total_loss(two->losses(*batch, {5, 7, 1})), first);
  EXPECT_NE(total_loss(two->losses(*batch, {5, 7, 0})), first);
  EXPECT_NE(total_loss(two->losses(*batch, {5, 8, 1})), first);
  EXPECT_NE(total_loss(two->losses(*batch, {6, 7, 1})), first);
}

TEST_F(StructureFlow, TheLossIsTheSumOfBothStreamsAndOfItsTimeBins) {
  const auto flow = stage();
  const auto batch = flow->data().load({loaders::Draw{0, 0}});
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

TEST_F(StructureFlow, DroppedConditionsDoNotSeeThePicture) {
  const auto always = stage({"trainer.args.p_uncond=1"}), never = stage({"trainer.args.p_uncond=0"});
  const auto batch = batch_of(*always);
  auto& latents = dynamic_cast<loaders::StructureLatentBatch&>(*batch);
  const double dropped = total_loss(always->losses(*batch, {5, 0, 0})),
               kept = total_loss(never->losses(*batch, {5, 0, 0}));
  EXPECT_NE(dropped, kept);
  latents.cond = 1.0 - latents.cond;
  EXPECT_EQ(total_loss(always->losses(*batch, {5, 0, 0})), dropped);
  EXPECT_NE(total_loss(never->losses(*batch, {5, 0, 0})), kept);
}

TEST_F(StructureFlow, NormalsCanBeTheCondition) {
  for (int i = 0; i < test::PublishedSample::kAssets; ++i) {
    for (const char* name : {"000_normal.png", "001_normal.png"}) {
      io::write_png(sample_.condition(i) / name, test::PublishedSample::picture(127, 127, 255));
    }
  }
  const std::string all = "trainer.args.p_uncond=0";
  const auto color = stage({all}), normal = stage({all, "dataset.args.condition=normal"});
  const auto batch = batch_of(*normal);
  const Tensor pictures = dynamic_cast<const loaders::StructureLatentBatch&>(*batch).cond;
  EXPECT_GT(pictures.select(1, 2).max().item<float>(), 0.9f) << "a surface that looks at the camera is blue";
  EXPECT_LT(pictures.select(1, 0).max().item<float>(), 0.7f) << "127 of 255, and what Lanczos overshoots at an edge";
  const double loss = total_loss(normal->losses(*batch, {5, 0, 0}));
  EXPECT_TRUE(std::isfinite(loss));
  EXPECT_NE(loss, total_loss(color->losses(*batch_of(*color), {5, 0, 0})));
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
  const std::vector<std::string> frozen = {"models.denoiser.args.use_pretrain_branch=true",
                                           "models.denoiser.args.freeze_pretrain_branch=true"};
  EXPECT_THROW(stage(frozen)->warm_start({}), InputError) << "a frozen branch without its warm start";
  const auto open = stage({frozen[0], frozen[1], "trainer.args.warm_start=none"});
  for (const auto& parameter : open->models().front().module->named_parameters()) {
    EXPECT_TRUE(parameter.value().requires_grad()) << parameter.key() << ": nothing is frozen without a warm start";
  }
  // With one, the shape stream is frozen, and a replica computes the same although it shares no trained parameter of
  // it.
  const auto pretrained = folder_ / "AniGenSparseStructureFlowModel.safetensors";
  io::write_safetensors(pretrained, models::state_dict(*open->models().front().module));
  const auto flow = stage({frozen[0], frozen[1], "trainer.args.pretrained_dir=" + folder_.path().string()});
  flow->warm_start({});
  const auto twin = flow->replica();
  ParameterBuffer buffer(flow->models());
  const ParameterBuffer shared = buffer.share(twin->models());
  EXPECT_LT(buffer.slots().size(), flow->models().front().module->parameters().size());
  const auto batch = batch_of(*flow);
  EXPECT_EQ(total_loss(twin->losses(*batch, {5, 0, 0})), total_loss(flow->losses(*batch, {5, 0, 0})));
}

TEST_F(StructureFlow, LearnsAndLogs) {
  train(command("run", {"trainer.args.max_steps=200", "trainer.args.i_log=20", "trainer.args.i_save=200",
                        "trainer.args.i_eval=100"}));
  const CsvTable metrics = read_csv(folder_ / "run/metrics.csv");
  for (const char* column :
       {"loss.total", "loss.mse", "loss.mse_skl", "loss.bin_7.mse", "loss.bin_7.mse_skl", "eval.mse", "eval.mse_skl"}) {
    EXPECT_NE(metrics.column(column), CsvTable::kMissing) << column;
  }
  std::vector<double> losses;
  for (std::size_t row = 0; row < metrics.rows.size(); ++row) {
    if (!metrics.cell(row, "loss.total").empty()) losses.push_back(std::stod(metrics.cell(row, "loss.total")));
  }
  // Every row is the mean over 20 steps of 4 assets at random times; thirds of the run smooth that further.
  const auto third = static_cast<std::ptrdiff_t>(losses.size() / 3);
  ASSERT_GT(third, 0);
  EXPECT_LT(std::accumulate(losses.end() - third, losses.end(), 0.0),
            std::accumulate(losses.begin(), losses.begin() + third, 0.0));
  for (const char* file : {"ckpts/denoiser_step0000200.safetensors", "ckpts/image_encoder_step0000200.safetensors"}) {
    EXPECT_TRUE(std::filesystem::exists(folder_ / "run" / file)) << file;
  }
}

TEST_F(StructureFlow, ResumedRunsEndWithTheSameBits) {
  for (const std::string& precision : {std::string("fp32"), std::string("bf16")}) {
    const std::vector<std::string> overrides{"trainer.args.precision=" + precision, "trainer.args.replicas=2"};
    std::vector<std::string> leg = overrides;
    leg.push_back("trainer.args.max_steps=8");
    train(command(precision + "_whole", overrides));
    train(command(precision + "_legs", leg));
    train(command(precision + "_legs", overrides));
    for (const char* name : {"denoiser", "denoiser_ema0.9", "image_encoder", "image_encoder_ema0.9"}) {
      const std::string file = std::string("ckpts/") + name + "_step0000012.safetensors";
      EXPECT_EQ(bytes(precision + "_whole/" + file), bytes(precision + "_legs/" + file)) << file;
    }
  }
  EXPECT_NE(bytes("fp32_whole/ckpts/denoiser_step0000012.safetensors"),
            bytes("bf16_whole/ckpts/denoiser_step0000012.safetensors"));
}

TEST_F(StructureFlow, SixteenBitBlocksComeCloseAndKeepFullPrecisionMasters) {
  const auto plain = stage(), reduced = stage();
  const auto batch = batch_of(*plain);
  ParameterBuffer buffer(reduced->models(), [&] { reduced->set_compute_dtype(torch::kBFloat16); });
  const double expected = total_loss(plain->losses(*batch, {5, 0, 0})),
               found = total_loss(reduced->losses(*batch, {5, 0, 0}));
  EXPECT_NE(found, expected);
  EXPECT_NEAR(found, expected, 0.05 * expected) << "bf16 has 8 bits of mantissa";
  std::vector<Tensor> full;
  for (const NamedModel& model : plain->models()) {
    for (const Tensor& parameter : model.module->parameters()) full.push_back(parameter.detach().reshape({-1}));
  }
  EXPECT_TRUE(torch::equal(buffer.master(), torch::cat(full))) << "masters keep what bf16 rounds away";
  EXPECT_THROW(train(command("fp16", {"trainer.args.precision=fp16-published"})), NotSupportedError);
}

TEST_F(StructureFlow, WithoutPicturesItLearnsTheDistribution) {
  const std::vector<std::string> overrides{
      "trainer.name=AniGenFlowMatchingTrainer",
      R"(dataset={"name": "AniGenSparseStructureLatent", "args": {"latent_model": "ss"}})"};
  Json config = parse_json(kFlowConfig, "test");
  config["trainer"]["args"].erase("image_encoder");
  config["trainer"]["args"]["i_eval"] = 0;
  write_file_atomically(folder_ / "config.json", config.dump());
  train(command("run", overrides));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "run/ckpts/denoiser_step0000012.safetensors"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "run/ckpts/image_encoder_step0000012.safetensors"));
}

TEST_F(StructureFlow, SamplesBecomeASheetAndATensorBoardPicture) {
  const Json decoder = {{"latent_channels", 8},       {"latent_channels_skl", 4},    {"num_res_blocks", 1},
                        {"num_res_blocks_middle", 1}, {"channels", {4, 4, 4}},       {"encode_global", false},
                        {"encode_global_skl", false}, {"use_pretrain_branch", false}};
  Json run;
  run["models"]["decoder"] = {{"name", "AniGenSparseStructureDecoder"}, {"args", decoder}};
  write_file_atomically(folder_ / "ss_run/config.json", run.dump());
  models::SparseStructureDecoder model(models::SparseStructureDecoderOptions::from_json(decoder));
  io::write_safetensors(folder_ / "ss_run/ckpts/decoder_step0000001.safetensors", models::state_dict(*model));

  train(command("run", {"trainer.args.max_steps=2", "trainer.args.i_sample=100",
                        "dataset.args.ss_dec_path=" + (folder_ / "ss_run").string()}));
  const io::Image sheet = io::read_image(folder_ / "run/samples/step2/samples.png");
  EXPECT_GT(sheet.width, 4 * 192) << "picture, guided, not guided, truth";
  std::string events;
  for (const auto& file : std::filesystem::directory_iterator(folder_ / "run/tb_logs"))
    events += read_file(file.path());
  EXPECT_NE(events.find("samples/samples"), std::string::npos);
  EXPECT_NE(events.find("\x89PNG"), std::string::npos);
  EXPECT_THROW(train(command("bad", {"trainer.args.i_sample=1", "dataset.args.ss_dec_path=nowhere"})), InputError);
}

TEST_F(StructureFlow, BadConfigsNameTheKey) {
  const auto message = [&](const std::vector<std::string>& overrides) {
    try {
      stage(overrides);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  EXPECT_NE(message({"dataset.args.image_size=16"}).find("image_size"), std::string::npos);
  EXPECT_NE(message({"trainer.args.image_encoder={\"name\": \"dinov2\"}"}).find("weights"), std::string::npos);
  EXPECT_NE(message({"trainer.args.image_encoder.nme=1"}).find("nme"), std::string::npos);
  EXPECT_NE(message({"trainer.args.p_uncnd=1"}).find("p_uncond"), std::string::npos);
  EXPECT_NE(message({"trainer.args.sampler.sigma_min=0.001"}).find("sigma_min"), std::string::npos);
  EXPECT_NE(message({"trainer.args.sampler.steps=null"}).find("steps"), std::string::npos);
  EXPECT_NE(message({"trainer.args.train_inpaint=true"}).find("not supported"), std::string::npos);
  EXPECT_NE(message({"trainer.name=AniGenFlowMatchingTrainer"}).find("AniGenSparseStructureLatent"), std::string::npos);
  EXPECT_NE(message({"trainer.name=Other"}).find("AniGenSparseStructureVaeTrainer"), std::string::npos);
  EXPECT_NE(message({"models.denoiser.args.num_blcks=1"}).find("num_blocks"), std::string::npos);
}

}  // namespace
}  // namespace anigen::train
