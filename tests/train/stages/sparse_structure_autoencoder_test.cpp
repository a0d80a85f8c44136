#include "anigen/train/stages/sparse_structure_autoencoder.h"

#include <gtest/gtest.h>

#include <fstream>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/table.h"
#include "anigen/data/datasets.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/state_dict.h"
#include "anigen/train/train_command.h"
#include "anigen/train/trainer_state.h"
#include "tests/support/paths.h"
#include "tests/train/stages/run_folder.h"
#include "tests/train/stages/sparse_structure_dataset.h"

namespace anigen::train {
namespace {

namespace fs = std::filesystem;

// Freezes the shape stream, as published.
const std::vector<std::string> kFrozen = {"models.encoder.args.use_pretrain_branch=true",
                                          "models.decoder.args.use_pretrain_branch=true"};

class BallRun : public ::testing::Test {
 protected:
  void SetUp() override {
    test::write_ball_dataset(folder_ / "data", 8);
    std::ofstream(folder_ / "config.json") << test::kBallConfig;
  }
  TrainCommand command(const std::string& output, std::vector<std::string> overrides = {}) {
    return test::train_command(folder_, output, std::move(overrides));
  }
  // A fresh encoder and decoder under the names of pretrained files.
  void write_pretrained() {
    torch::manual_seed(77);
    const Json config = Json::parse(test::kBallConfig);
    const auto args = [&](const char* model) { return config["models"][model]["args"]; };
    sparse_structure::SparseStructureEncoder encoder(
        sparse_structure::SparseStructureEncoderOptions::from_json(args("encoder")));
    sparse_structure::SparseStructureDecoder decoder(
        sparse_structure::SparseStructureDecoderOptions::from_json(args("decoder")));
    fs::create_directories(folder_ / "pretrained");
    write_stream(*encoder, "pretrained/AniGenSparseStructureEncoder", /*skeleton=*/false);
    write_stream(*decoder, "pretrained/AniGenSparseStructureDecoder", /*skeleton=*/false);
    write_stream(*encoder, "encoder_skl", /*skeleton=*/true);
  }
  void write_stream(const torch::nn::Module& model, const std::string& name, bool skeleton) {
    io::NamedArrays arrays;
    for (auto& [key, array] : nn::state_dict(model)) {
      if ((key.find("_skl") != std::string::npos) == skeleton) arrays.emplace_back(key, array);
    }
    io::write_safetensors(folder_ / (name + ".safetensors"), arrays);
  }
  io::NamedArrays arrays_of(const std::string& file) { return io::read_safetensors(folder_ / file).tensors; }
  std::string finetune(const std::string& model, const std::string& file) {
    return "trainer.args.finetune_ckpt." + model + "=" + (folder_ / file).string();
  }
  std::string message(const std::string& output, const std::vector<std::string>& overrides) {
    try {
      train(command(output, overrides));
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }
  std::vector<std::string> frozen(std::vector<std::string> more = {}) {
    more.insert(more.end(), kFrozen.begin(), kFrozen.end());
    more.push_back("trainer.args.pretrained_dir=" + (folder_ / "pretrained").string());
    return more;
  }
  std::string bytes(const std::string& file) { return read_file(folder_ / file); }
  double logged(const std::string& run, std::size_t row, const std::string& column) {
    return std::stod(read_csv(folder_ / run / "metrics.csv").cell(row, column));
  }
  test::TemporaryFolder folder_;
};

TEST_F(BallRun, LearnsTheBallsAndSaysHowWell) {
  // At 0.01 it depends on the last bits whether the skeleton is learned at all; at this rate six of six seeds learn it.
  train(command("run", {"trainer.args.max_steps=240", "trainer.args.i_eval=240", "trainer.args.i_log=80",
                        "trainer.args.optimizer.args.lr=0.005"}));
  const CsvTable metrics = read_csv(folder_ / "run/metrics.csv");
  for (const char* column : {"loss.total", "loss.dice", "loss.dice_skl", "loss.kl", "eval.iou_shape", "eval.f1_shape",
                             "eval.iou_skl", "eval.f1_skl"}) {
    EXPECT_NE(metrics.column(column), CsvTable::kMissing) << column;
  }
  EXPECT_EQ(metrics.column("loss.kl_skl"), CsvTable::kMissing) << "a latent with noise has no posterior";
  EXPECT_LT(logged("run", 1, "loss.dice"), logged("run", 0, "loss.dice"));
  EXPECT_LT(logged("run", 2, "loss.dice"), 0.9 * logged("run", 0, "loss.dice"));
  EXPECT_LT(logged("run", 2, "loss.dice_skl"), 0.9 * logged("run", 0, "loss.dice_skl"));
  for (std::size_t row = 0; row < metrics.rows.size(); ++row) {
    if (metrics.cell(row, "eval.iou_shape").empty()) continue;
    // One tolerates a voxel, the other does not; both are shares.
    EXPECT_GE(logged("run", row, "eval.f1_shape"), logged("run", row, "eval.iou_shape"));
    EXPECT_LE(logged("run", row, "eval.f1_shape"), 1.0);
  }
}

TEST_F(BallRun, ResumedRunsEndWithTheSameBits) {
  write_pretrained();
  train(command("whole", frozen()));
  train(command("legs", frozen({"trainer.args.max_steps=5"})));
  for (const char* name : {"state", "encoder", "decoder", "encoder_ema0.9", "decoder_ema0.9"})
    fs::remove(folder_ / "legs/ckpts" / (std::string(name) + "_step0000005.safetensors"));
  train(command("legs", frozen()));
  for (const char* name : {"encoder", "decoder", "encoder_ema0.9", "decoder_ema0.9"}) {
    const std::string file = std::string("ckpts/") + name + "_step0000008.safetensors";
    EXPECT_EQ(bytes("whole/" + file), bytes("legs/" + file)) << file;
  }
}

// "paper" puts both latents on the ℓ1 sphere and noise on both; "published" changes no bit.
TEST_F(BallRun, ThePapersLatentsAreASwitch) {
  const std::string file = "ckpts/encoder_step0000008.safetensors";
  train(command("plain"));
  train(command("published", {"trainer.args.compatibility=published"}));
  EXPECT_EQ(bytes("published/" + file), bytes("plain/" + file));
  train(command("paper", {"trainer.args.compatibility=paper"}));
  EXPECT_TRUE(read_csv(folder_ / "plain/metrics.csv").column("loss.kl") != CsvTable::kMissing);
  EXPECT_EQ(read_csv(folder_ / "paper/metrics.csv").column("loss.kl"), CsvTable::kMissing) << "no posterior is left";
  // The run's config says all of it to those who use the models.
  const Json config = read_json(folder_ / "paper/config.json");
  auto encoder = nn::load_trained<sparse_structure::SparseStructureEncoder>(
      nn::find_run_model(folder_ / "paper", sparse_structure::kSparseStructureEncoderClass), torch::kCPU);
  const auto latents = encoder->forward(torch::ones({1, 1, 16, 16, 16}), torch::ones({1, 1, 16, 16, 16}));
  for (const torch::Tensor& z : {latents.z, latents.z_skl})
    EXPECT_TRUE(torch::allclose(z.norm(1, 1), torch::ones_like(z.norm(1, 1)), 1e-4));
  const Json& args = config["trainer"]["args"];
  EXPECT_EQ(args["latent_time_max"], 0.75);
  EXPECT_EQ(args["latent_time_max_skl"], 0.25) << "what a config says stays";
  EXPECT_EQ(args["latent_achive_max_step"], 8);

  // A frozen shape keeps its latents, which the pretrained weights are of.
  write_pretrained();
  train(command("frozen", frozen({"trainer.args.compatibility=paper"})));
  EXPECT_TRUE(read_csv(folder_ / "frozen/metrics.csv").column("loss.kl") != CsvTable::kMissing);
}

TEST_F(BallRun, ResumedRunsNeedNoWarmStartFiles) {
  write_pretrained();
  train(command("run", frozen({"trainer.args.max_steps=3", finetune("encoder", "encoder_skl.safetensors")})));
  fs::remove_all(folder_ / "pretrained");
  fs::remove(folder_ / "encoder_skl.safetensors");
  const auto start = CheckpointFolder(folder_ / "run/ckpts").weights("decoder", 3);
  train(command("run", frozen({finetune("encoder", "encoder_skl.safetensors")})));
  const auto trained = CheckpointFolder(folder_ / "run/ckpts").weights("decoder", 8);
  EXPECT_EQ(io::find(trained, "input_layer.weight")->bytes, io::find(start, "input_layer.weight")->bytes);
  // A run that begins anew needs them.
  TrainCommand anew = command("run", frozen());
  anew.run.ckpt = "none";
  anew.run.restart = true;
  EXPECT_THROW(train(anew), InputError);
}

TEST_F(BallRun, SixteenBitRunsResumeAndSaveFrozenWeightsAsTheyWereLoaded) {
  write_pretrained();
  const std::vector<std::string> overrides = frozen({"trainer.args.precision=bf16", "trainer.args.replicas=2"});
  train(command("whole", overrides));
  std::vector<std::string> leg = overrides;
  leg.push_back("trainer.args.max_steps=5");
  train(command("legs", leg));
  fs::rename(folder_ / "pretrained", folder_ / "away");
  train(command("legs", overrides));
  for (const char* name : {"encoder", "decoder", "encoder_ema0.9", "decoder_ema0.9"}) {
    const std::string file = std::string("ckpts/") + name + "_step0000008.safetensors";
    EXPECT_EQ(bytes("whole/" + file), bytes("legs/" + file)) << file;
    const std::string model = std::string(name).substr(0, 7);
    const io::NamedArrays start = arrays_of(std::string("away/AniGenSparseStructure") +
                                            (model == "encoder" ? "Encoder" : "Decoder") + ".safetensors");
    const io::NamedArrays trained = arrays_of("legs/" + file);
    for (const auto& [key, array] : start) {
      EXPECT_EQ(io::find(trained, key)->dtype, array.dtype) << name << " " << key;
      EXPECT_EQ(io::find(trained, key)->bytes, array.bytes) << name << " " << key;
    }
  }
}

TEST_F(BallRun, ReplicasTrainTheSameModel) {
  write_pretrained();
  train(command("one", frozen({"trainer.args.i_eval=0"})));
  train(command("two", frozen({"trainer.args.i_eval=0", "trainer.args.replicas=2"})));
  // The frozen stream of the replica is that of the original: the same loss up to rounding.
  for (const char* column : {"loss.dice", "loss.dice_skl", "loss.kl"}) {
    EXPECT_NEAR(logged("one", 0, column), logged("two", 0, column), 1e-6) << column;
    EXPECT_NEAR(logged("one", 6, column), logged("two", 6, column), 1e-3) << column;
  }
}

TEST_F(BallRun, FrozenBranchesKeepTheirWarmStart) {
  write_pretrained();
  train(command("run", frozen()));
  const io::NamedArrays trained = CheckpointFolder(folder_ / "run/ckpts").weights("encoder", 8);
  const io::NamedArrays start =
      io::read_safetensors(folder_ / "pretrained/AniGenSparseStructureEncoder.safetensors").tensors;
  for (const auto& [key, array] : start) EXPECT_EQ(io::find(trained, key)->bytes, array.bytes) << key;
  EXPECT_GT(trained.size(), start.size());
}

TEST_F(BallRun, AFrozenBranchWithoutWarmStartIsAnErrorUnlessItIsTrained) {
  try {
    train(command("none", frozen()));
    FAIL() << "expected an error";
  } catch (const InputError& error) {
    const std::string message = error.what();
    EXPECT_NE(message.find("AniGenSparseStructureEncoder"), std::string::npos) << message;
    EXPECT_NE(message.find("warm_start"), std::string::npos) << message;
  }
  EXPECT_FALSE(fs::exists(folder_ / "none/ckpts"));
  train(command("run", frozen({"trainer.args.warm_start=none", "trainer.args.max_steps=3"})));
  const CheckpointFolder checkpoints(folder_ / "run/ckpts");
  train(command("start", frozen({"trainer.args.warm_start=none", "trainer.args.max_steps=0"})));
  const io::NamedArrays before = CheckpointFolder(folder_ / "start/ckpts").weights("decoder", 0);
  const io::NamedArrays after = checkpoints.weights("decoder", 3);
  EXPECT_NE(io::find(before, "input_layer.weight")->bytes, io::find(after, "input_layer.weight")->bytes);
}

TEST_F(BallRun, FineTuningFilesCountAsWarmStartOfWhatTheyHold) {
  write_pretrained();
  fs::rename(folder_ / "pretrained", folder_ / "away");
  const std::string skeleton = finetune("encoder", "encoder_skl.safetensors");
  const std::string refusal = message("skeleton", frozen({skeleton}));
  for (const char* part : {"AniGenSparseStructureEncoder", "input_layer.weight", "modules_to_freeze"})
    EXPECT_NE(refusal.find(part), std::string::npos) << refusal;
  const std::vector<std::string> shape = {finetune("encoder", "away/AniGenSparseStructureEncoder.safetensors"),
                                          finetune("decoder", "away/AniGenSparseStructureDecoder.safetensors"),
                                          "trainer.args.max_steps=0"};
  EXPECT_EQ(message("shape", frozen(shape)), "no error");
  // Both: each fills its stream.
  fs::rename(folder_ / "away", folder_ / "pretrained");
  EXPECT_EQ(message("both", frozen({skeleton, "trainer.args.max_steps=0"})), "no error");
  const io::NamedArrays started = CheckpointFolder(folder_ / "both/ckpts").weights("encoder", 0);
  for (const char* file : {"encoder_skl.safetensors", "pretrained/AniGenSparseStructureEncoder.safetensors"}) {
    for (const auto& [key, array] : arrays_of(file)) EXPECT_EQ(io::find(started, key)->bytes, array.bytes) << key;
  }
}

TEST_F(BallRun, AWarmStartFileOfAnotherModelIsAnError) {
  write_pretrained();
  io::write_safetensors(folder_ / "pretrained/AniGenSparseStructureDecoder.safetensors",
                        {{"unrelated", io::NdArray::from(std::vector<float>{1.0F, 2.0F}, {2})}});
  const std::string refusal = message("run", frozen({"models.decoder.args.freeze_pretrain_branch=false"}));
  EXPECT_NE(refusal.find("AniGenSparseStructureDecoder.safetensors"), std::string::npos) << refusal;
  EXPECT_NE(refusal.find("none of its tensors"), std::string::npos) << refusal;
}

TEST_F(BallRun, GridsThatTheModelsCannotEncodeAreAnErrorOfTheDataset) {
  EXPECT_NE(message("bad", {"dataset.args.resolution=15"}).find("/dataset/args/resolution"), std::string::npos);
  const std::string tokens =
      message("bad", {"models.encoder.args.encode_global_skl=true", "models.decoder.args.encode_global_skl=true",
                      "models.encoder.args.channels=[4, 16]", "models.decoder.args.channels=[16, 4]",
                      "models.encoder.args.latent_channels_skl=4", "models.decoder.args.latent_channels_skl=4"});
  EXPECT_NE(tokens.find("/dataset/args/resolution"), std::string::npos) << tokens;
  EXPECT_NE(tokens.find("64"), std::string::npos) << tokens;
}

TEST_F(BallRun, BadConfigsNameTheKey) {
  const auto message = [&](const std::string& override) { return BallRun::message("bad", {override}); };
  EXPECT_NE(message("trainer.args.loss_type=mse").find("loss_type"), std::string::npos);
  EXPECT_NE(message("trainer.args.latent_achieve_max_step=3").find("latent_achive_max_step"), std::string::npos);
  EXPECT_NE(message("models.decoder.args.latent_channels=5").find("latent_channels"), std::string::npos);
  EXPECT_NE(message("models.encoder.args.in_channels=2").find("one channel"), std::string::npos);
  EXPECT_NE(message("models.encoder.args.in_channels=2").find("/models/encoder/args/in_channels"), std::string::npos);
  EXPECT_NE(message("models.decoder.args.out_channels_skl=2").find("/models/decoder/args/out_channels_skl"),
            std::string::npos);
  EXPECT_NE(message("models.decoder.args.normalize_scale=0").find("normalize_scale"), std::string::npos);
  EXPECT_NE(message("models.encoder.name=SkinAutoEncoder").find("name"), std::string::npos);
  EXPECT_NE(message("dataset.name=AniGenSLat").find("AniGenSparseStructure"), std::string::npos);
}

TEST_F(BallRun, DrawsDependOnTheContextAndOnNothingElse) {
  const Json config = Json::parse(test::kBallConfig);
  SparseStructureCoders coders;
  coders.encoder = sparse_structure::SparseStructureEncoderOptions::from_json(config["models"]["encoder"]["args"]);
  coders.decoder = sparse_structure::SparseStructureDecoderOptions::from_json(config["models"]["decoder"]["args"]);
  Json dataset = config["dataset"];
  dataset["args"]["data_dir"] = (folder_ / "data").string();
  const data::Datasets data = data::make_datasets(ConfigReader(dataset, "config.json", "/dataset"), 1);
  SparseStructureAutoEncoderStageOptions options;
  options.noise_skl = {true, 1.0, 0.5, 0};
  torch::manual_seed(9);
  SparseStructureAutoEncoderStage stage(coders, options, data.train, data.eval, torch::kCPU);
  {
    const torch::NoGradGuard no_grad;  // a fresh decoder's residual branches are zero
    for (torch::Tensor& parameter : stage.decoder()->parameters()) parameter.add_(0.1 * torch::randn_like(parameter));
  }
  const auto batch = data.train->load({{0, 0}, {1, 1}});
  const auto loss = [&](const LossContext& context) {
    torch::randn({3});  // moves LibTorch's own generator
    return stage.losses(*batch, context).total.item<double>();
  };
  const double first = loss({7, 3, 0});
  EXPECT_EQ(loss({7, 3, 0}), first);
  EXPECT_NE(loss({8, 3, 0}), first);
  EXPECT_NE(loss({7, 4, 0}), first);
  EXPECT_NE(loss({7, 3, 1}), first);
}

TEST_F(BallRun, SamplesArePictures) {
  train(command("run", {"trainer.args.max_steps=2", "trainer.args.i_sample=2", "trainer.args.i_eval=0"}));
  EXPECT_TRUE(fs::exists(folder_ / "run/samples/step2/reconstructions.png"));
  EXPECT_TRUE(fs::exists(folder_ / "run/samples/step2/between_latents.png"));
}

}  // namespace
}  // namespace anigen::train
