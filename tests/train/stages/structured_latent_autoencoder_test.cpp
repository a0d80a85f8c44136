#include "anigen/train/stages/structured_latent_autoencoder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/table.h"
#include "anigen/data/datasets.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/state_dict.h"
#include "anigen/skin_field/skin_autoencoder.h"
#include "anigen/train/stages/structured_latent_report.h"
#include "anigen/train/train_command.h"
#include "anigen/train/trainer_state.h"
#include "tests/support/paths.h"
#include "tests/train/stages/run_folder.h"
#include "tests/train/stages/structured_latent_dataset.h"

namespace anigen::train {
namespace {

namespace fs = std::filesystem;

// The models are those of test::post_models().
constexpr char kPostConfig[] = R"({
  "dataset": {"name": "AniGenSparseFeat2Skeleton", "args": {
    "image_size": 24, "model": "toy", "skl_dilation_iter": 1, "load_cubvh": true, "test_mode": false,
    "eval_split": "splits/test.txt"}},
  "trainer": {"name": "AniGenSLatVaeSkeletonTrainer", "args": {
    "max_steps": 4, "batch_size": 2, "batch_split": 2, "seed": 5,
    "optimizer": {"name": "AdamW", "args": {"lr": 0.003}},
    "grad_clip": {"name": "AdaptiveGradClipper", "args": {"max_norm": 1.0, "buffer_size": 4}},
    "ema_rate": [0.9], "fp16_mode": "none", "i_log": 1, "i_print": 0, "i_save": 2, "i_eval": 0, "i_sample": 0,
    "skin_ae": "joint", "lambda_lpips": 0, "lambda_color": 0.1, "lambda_joints": 10, "lambda_parents": 5,
    "latent_denoising_skl": true, "latent_time_max_skl": 0.75, "latent_achive_max_step_skl": 10,
    "eval_surface_points": 200}}})";

// Freezes the shape stream, as published.
const std::vector<std::string> kFrozenShape = {"models.encoder.args.use_pretrain_branch=true",
                                               "models.decoder.args.use_pretrain_branch=true",
                                               "models.decoder.args.modules_to_freeze="
                                               "[\"input_layer\", \"blocks\", \"upsample\", \"out_layer\"]"};

class PostRun : public ::testing::Test {
 protected:
  void SetUp() override {
    test::PostDataset::write(folder_ / "data", 3);
    Json config = Json::parse(kPostConfig);
    config["models"] = test::post_models();
    std::ofstream(folder_ / "config.json") << config.dump();
  }
  TrainCommand command(const std::string& output, std::vector<std::string> overrides = {}) {
    return test::train_command(folder_, output, std::move(overrides));
  }
  std::string message(const std::vector<std::string>& overrides) {
    try {
      train(command("bad", overrides));
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }
  CsvTable metrics(const std::string& run) { return read_csv(folder_ / run / "metrics.csv"); }
  double logged(const std::string& run, std::size_t row, const std::string& column) {
    return std::stod(metrics(run).cell(row, column));
  }
  bool has_column(const std::string& run, const std::string& column) {
    return metrics(run).column(column) != CsvTable::kMissing;
  }
  std::string bytes(const std::string& file) { return read_file(folder_ / file); }

  static Json model_args(const char* model) { return test::post_models()[model]["args"]; }
  static StructuredLatentCoders coders() {
    StructuredLatentCoders coders;
    coders.encoder = structured_latent::StructuredLatentEncoderOptions::from_json(model_args("encoder"));
    coders.decoder = structured_latent::StructuredLatentDecoderOptions::from_json(model_args("decoder"));
    return coders;
  }
  // A stage on the training assets whose weights are nowhere exactly zero.
  std::unique_ptr<StructuredLatentAutoEncoderStage> stage(const StructuredLatentAutoEncoderStageOptions& options) {
    torch::manual_seed(9);
    const data::Datasets data = datasets();
    auto made =
        std::make_unique<StructuredLatentAutoEncoderStage>(coders(), options, data.train, data.eval, torch::kCPU);
    const torch::NoGradGuard no_grad;
    for (const auto& module : made->models()) {
      for (torch::Tensor& parameter : module.module->parameters()) {
        if (parameter.requires_grad()) parameter.add_(0.02 * torch::randn_like(parameter));
      }
    }
    return made;
  }
  data::Datasets datasets() {
    Json dataset = Json::parse(kPostConfig)["dataset"];
    dataset["args"]["data_dir"] = (folder_ / "data").string();
    return data::make_datasets(ConfigReader(dataset, "config.json", "/dataset"), 1);
  }
  static StructuredLatentAutoEncoderStageOptions stage_options() {
    StructuredLatentAutoEncoderStageOptions options;
    options.geometry.perceptual.lambda_lpips = 0.0;
    options.geometry.lambda_color = 0.1;
    options.variant.joint_skin = true;
    return options;
  }
  // Fresh weights of the shape under the names of pretrained files.
  void write_pretrained() {
    torch::manual_seed(77);
    structured_latent::StructuredLatentEncoder encoder(
        structured_latent::StructuredLatentEncoderOptions::from_json(model_args("encoder")));
    structured_latent::StructuredLatentDecoder decoder(
        structured_latent::StructuredLatentDecoderOptions::from_json(model_args("decoder")));
    write_shape(*encoder, "AniGenElasticSLatEncoder");
    write_shape(*decoder, "AniGenElasticSLatMeshDecoder");
  }
  void write_shape(const torch::nn::Module& model, const std::string& name) {
    io::NamedArrays arrays;
    for (auto& [key, array] : nn::state_dict(model)) {
      for (const char* part : {"input_layer.", "blocks.", "upsample.", "out_layer."}) {
        if (key.rfind(part, 0) == 0) arrays.emplace_back(key, array);
      }
    }
    fs::create_directories(folder_ / "pretrained");
    io::write_safetensors(folder_ / "pretrained" / (name + ".safetensors"), arrays);
  }
  std::vector<std::string> frozen_shape(std::vector<std::string> more = {}) {
    more.insert(more.end(), kFrozenShape.begin(), kFrozenShape.end());
    more.push_back("trainer.args.pretrained_dir=" + (folder_ / "pretrained").string());
    return more;
  }
  // A run folder of stage 1 with fresh weights.
  skin_field::SkinAutoEncoder write_skin_run() {
    const Json args = {{"encoder_config", model_args("encoder")["skin_encoder_config"]},
                       {"decoder_config", model_args("decoder")["skin_decoder_config"]}};
    torch::manual_seed(78);
    skin_field::SkinAutoEncoder model(skin_field::SkinAutoEncoderOptions::from_json(args));
    const Json config = {{"models", {{"model", {{"name", "SkinAutoEncoder"}, {"args", args}}}}}};
    write_file_atomically(folder_ / "skin_run" / "config.json", config.dump());
    io::write_safetensors(folder_ / "skin_run" / "ckpts" / "model_step0000001.safetensors", nn::state_dict(*model));
    return model;
  }
  std::vector<std::string> with_skin_run() {
    return {"trainer.args.skin_ae=pretrained", "trainer.args.warm_start=none",
            "trainer.args.skin_ae_run=" + (folder_ / "skin_run").string()};
  }
  test::TemporaryFolder folder_;
};

TEST_F(PostRun, LearnsTheSkeletonAndLogsEveryTerm) {
  train(command("run", {"trainer.args.max_steps=30", "trainer.args.i_log=10", "trainer.args.i_eval=10",
                        "trainer.args.i_save=0"}));
  for (const char* column : {"loss.total",
                             "loss.kl",
                             "loss.reg_loss",
                             "loss.geo_loss",
                             "loss.tsdf_loss",
                             "loss.mask_loss",
                             "loss.depth_loss",
                             "loss.normal_loss",
                             "loss.normal_loss_ssim",
                             "loss.normal_loss_perceptual",
                             "loss.color_loss",
                             "loss.joints_loss",
                             "loss.parents_loss",
                             "loss.skin_feats_joints_var_loss",
                             "loss.skin_kl_loss",
                             "loss.skin_feats_l2_loss_vert",
                             "loss.skin_feats_l2_loss_joints",
                             "eval.surfaces",
                             "eval.chamfer",
                             "eval.joints_loss",
                             "eval.parents_loss",
                             "eval.skin_kl_loss",
                             "eval.joint_count_error",
                             "eval.joint_chamfer"}) {
    EXPECT_TRUE(has_column("run", column)) << column;
  }
  EXPECT_FALSE(has_column("run", "loss.kl_skl")) << "a latent with noise has no posterior";
  EXPECT_LT(logged("run", 2, "loss.joints_loss"), logged("run", 0, "loss.joints_loss"));
  EXPECT_LT(logged("run", 2, "loss.parents_loss"), logged("run", 0, "loss.parents_loss"));
  EXPECT_LT(logged("run", 2, "loss.total"), logged("run", 0, "loss.total"));
}

TEST_F(PostRun, ResumedRunsEndWithTheSameBits) {
  train(command("whole"));
  train(command("legs", {"trainer.args.max_steps=3"}));
  for (const char* name : {"state", "encoder", "decoder", "encoder_ema0.9", "decoder_ema0.9"})
    fs::remove(folder_ / "legs/ckpts" / (std::string(name) + "_step0000003.safetensors"));
  train(command("legs"));
  for (const char* name : {"encoder", "decoder", "encoder_ema0.9", "decoder_ema0.9"}) {
    const std::string file = std::string("ckpts/") + name + "_step0000004.safetensors";
    EXPECT_EQ(bytes("whole/" + file), bytes("legs/" + file)) << file;
  }
}

TEST_F(PostRun, VariantsTrain) {
  const std::string no_kappa = "models.encoder.args.jp_hyper_continuous=false",
                    free = "models.decoder.args.jp_hyper_continuous=false",
                    no_confidence = "models.decoder.args.representation_config.use_conf_jp=false";
  const std::vector<std::vector<std::string>> variants = {
      {no_kappa, free, no_confidence, "trainer.args.confidence=none"},
      {no_kappa, free, "trainer.args.confidence=learned"},
      {no_kappa, free, "trainer.args.confidence=bayesian"},
      {"trainer.args.geometry_only=true"},
      {"models.encoder.args.latent_denoising=false", "trainer.args.latent_denoising_skl=false"},
      {"trainer.args.normalization=l1"},
      {"trainer.args.normalization=none"},
      {"trainer.args.compatibility=paper"},
      {"trainer.args.depth_loss_type=smooth_l1", "trainer.args.skin_vertices=50", "dataset.args.load_cubvh=false"},
      {"trainer.args.precision=bf16"},
      {"trainer.args.replicas=2"}};
  int number = 0;
  for (std::vector<std::string> overrides : variants) {
    const std::string run = "variant" + std::to_string(number++);
    for (const char* more : {"trainer.args.max_steps=2", "trainer.args.i_eval=2", "trainer.args.i_save=0"})
      overrides.emplace_back(more);
    SCOPED_TRACE(overrides.front() + ", " + overrides[1]);
    train(command(run, overrides));
    EXPECT_TRUE(std::isfinite(logged(run, 0, "loss.total")));
    const bool geometry_only = overrides.front() == "trainer.args.geometry_only=true";
    EXPECT_EQ(has_column(run, "loss.joints_loss"), !geometry_only);
    EXPECT_EQ(has_column(run, "eval.joints_loss"), !geometry_only);
  }
  EXPECT_TRUE(has_column("variant4", "loss.kl_skl"));
}

// "paper" makes all three latents those of a denoising auto-encoder on the ℓ1 sphere; "published" changes no bit.
TEST_F(PostRun, ThePapersLatentsAreASwitch) {
  const std::string file = "ckpts/encoder_step0000004.safetensors";
  train(command("plain"));
  train(command("published", {"trainer.args.compatibility=published"}));
  EXPECT_EQ(bytes("published/" + file), bytes("plain/" + file));
  train(command("paper", {"trainer.args.compatibility=paper"}));
  EXPECT_NE(bytes("paper/" + file), bytes("plain/" + file));
  EXPECT_TRUE(has_column("plain", "loss.kl"));
  EXPECT_FALSE(has_column("paper", "loss.kl")) << "no posterior is left";
  const Json run = read_json(folder_ / "paper/config.json");
  const auto variant = structured_latent::StructuredLatentVariant::of_run(run, coders().decoder, "config.json");
  EXPECT_TRUE(variant.geometry_dae);
  EXPECT_EQ(variant.latent_norm, structured_latent::LatentNorm::kL1);
  EXPECT_EQ(variant.grouping, skeleton_field::MeanShiftForm::kPaper);
  EXPECT_EQ(run["trainer"]["args"]["latent_denoising"], true);
  EXPECT_EQ(run["trainer"]["args"]["latent_time_max"], 0.75);

  // One switch alone: geometry noise changes what the encoder learns although its posterior draws nothing.
  train(command("dae", {"trainer.args.geometry_latent=dae"}));
  EXPECT_TRUE(has_column("dae", "loss.kl")) << "of the skin's latent, which gets no noise by itself";
  write_pretrained();
  train(command("frozen", frozen_shape({"trainer.args.compatibility=paper"})));
  EXPECT_FALSE(read_json(folder_ / "frozen/config.json")["trainer"]["args"].contains("geometry_latent"));
}

TEST_F(PostRun, AFrozenShapeIsNotRenderedAndKeepsItsWarmStart) {
  write_pretrained();
  // Warm-started from nothing, the SkinAE's decoder of the joint variant is free to learn.
  train(command("run", frozen_shape()));
  EXPECT_FALSE(has_column("run", "loss.geo_loss"));
  EXPECT_FALSE(has_column("run", "loss.color_loss"));
  EXPECT_TRUE(has_column("run", "loss.reg_loss"));
  EXPECT_TRUE(has_column("run", "loss.joints_loss"));
  const io::NamedArrays trained = CheckpointFolder(folder_ / "run/ckpts").weights("decoder", 4);
  const io::NamedArrays start =
      io::read_safetensors(folder_ / "pretrained/AniGenElasticSLatMeshDecoder.safetensors").tensors;
  ASSERT_FALSE(start.empty());
  for (const auto& [key, array] : start) EXPECT_EQ(io::find(trained, key)->bytes, array.bytes) << key;
}

TEST_F(PostRun, AFrozenShapeWithoutWarmStartIsAnError) {
  const std::string refusal = message(frozen_shape());
  EXPECT_NE(refusal.find("AniGenElasticSLatEncoder"), std::string::npos) << refusal;
  EXPECT_NE(refusal.find("warm_start"), std::string::npos) << refusal;
}

TEST_F(PostRun, AFrozenEncoderStaysAndTheDecoderGoesOn) {
  train(command("first"));
  const CheckpointFolder first(folder_ / "first/ckpts");
  EXPECT_NE(message({"trainer.args.frozen_encoder=true"}).find("frozen_encoder"), std::string::npos);

  Json files;
  for (const char* model : {"encoder", "decoder"})
    files[model] = (folder_ / "first/ckpts" / (std::string(model) + "_step0000004.safetensors")).string();
  train(command("second", {"trainer.args.frozen_encoder=true", "trainer.args.finetune_ckpt=" + files.dump()}));
  const CheckpointFolder second(folder_ / "second/ckpts");
  const auto changed = [&](const char* model) {
    const io::NamedArrays before = first.weights(model, 4), after = second.weights(model, 4);
    return std::count_if(before.begin(), before.end(),
                         [&](const auto& entry) { return io::find(after, entry.first)->bytes != entry.second.bytes; });
  };
  EXPECT_EQ(changed("encoder"), 0);
  EXPECT_GT(changed("decoder"), 10);
  EXPECT_TRUE(has_column("first", "loss.kl"));
  EXPECT_FALSE(has_column("second", "loss.kl"));
  EXPECT_TRUE(has_column("second", "loss.geo_loss"));
  EXPECT_TRUE(has_column("second", "loss.joints_loss"));
}

TEST_F(PostRun, TheSkinAutoEncoderOfARunStaysAsItWas) {
  const io::NamedArrays start = nn::state_dict(*write_skin_run());
  train(command("run", with_skin_run()));
  const CheckpointFolder checkpoints(folder_ / "run/ckpts");
  for (const char* model : {"encoder", "decoder"}) {
    const io::NamedArrays trained = checkpoints.weights(model, 4);
    const std::string part = "skin_" + std::string(model) + ".";
    std::size_t found = 0;
    for (const auto& [key, array] : start) {
      if (key.rfind(part, 0) != 0) continue;
      ++found;
      EXPECT_EQ(io::find(trained, key)->bytes, array.bytes) << key;
    }
    EXPECT_GT(found, 0u) << model;
  }
  EXPECT_GT(logged("run", 0, "loss.skin_feats_l2_loss_vert"), 0.0) << "there are features to compare with";
}

TEST_F(PostRun, WithoutTheSkinAutoEncoderThereIsNoPretrainedVariant) {
  const std::string refusal = message({"trainer.args.skin_ae=pretrained", "trainer.args.warm_start=none"});
  EXPECT_NE(refusal.find("SkinAE"), std::string::npos) << refusal;
}

TEST_F(PostRun, PicturesTeachTheShape) {
  const auto made = stage(stage_options());
  ASSERT_TRUE(made->trains_geometry());
  const auto batch = made->data().load({{0, 0}, {1, 1}});
  const Losses losses = made->losses(*batch, {7, 3, 0});
  torch::Tensor pictures;
  for (const auto& [name, term] : losses.terms) {
    if (name == "geo_loss" || name == "color_loss") pictures = pictures.defined() ? pictures + term : term;
  }
  ASSERT_TRUE(pictures.defined());
  pictures.backward();
  const auto gradient = [](torch::nn::Module& model, const std::string& key) {
    for (const nn::StateEntry& entry : nn::state_entries(model)) {
      if (entry.key == key) return entry.tensor.grad().defined() ? entry.tensor.grad().abs().max().item<double>() : 0.0;
    }
    return -1.0;
  };
  for (const char* key : {"out_layer.weight", "upsample.0.out_layers.0.conv.weight", "blocks.0.attn.to_qkv.weight",
                          "input_layer.weight"}) {
    EXPECT_GT(gradient(*made->decoder(), key), 0.0) << key;
  }
  EXPECT_GT(gradient(*made->encoder(), "out_layer.weight"), 0.0);
  EXPECT_GT(gradient(*made->encoder(), "input_layer.weight"), 0.0);
  EXPECT_EQ(gradient(*made->decoder(), "out_layer_skl.weight"), 0.0) << "pictures say nothing about skeletons";
}

TEST_F(PostRun, ALostSurfaceIsPulledBackByALossOfItsOwn) {
  // The mean gradient of the eight signed distances' biases of a decoder that finds no cube's inside.
  const auto pull = [&](double weight, bool& named) {
    StructuredLatentAutoEncoderStageOptions options = stage_options();
    options.lambda_lost_surface = weight;
    options.variant.geometry_only = true;
    const auto made = stage(options);
    torch::Tensor bias = made->decoder()->named_parameters()["out_layer.bias"];
    {
      const torch::NoGradGuard no_grad;
      bias.slice(0, 0, 8).fill_(5.0);
    }
    const Losses losses = made->losses(*made->data().load({{0, 0}, {1, 1}}), {7, 3, 0});
    named = false;
    for (const auto& [name, term] : losses.terms) {
      EXPECT_NE(std::string(name), "geo_loss") << "there is no surface to render";
      named = named || std::string(name) == "lost_surface_loss";
    }
    losses.total.backward();
    return bias.grad().slice(0, 0, 8).mean().item<double>();
  };
  bool named = true;
  const double without = pull(0.0, named);
  EXPECT_FALSE(named);
  EXPECT_NEAR(without, 0.0, 1e-6);
  const double with = pull(1.0, named);
  EXPECT_TRUE(named);
  EXPECT_GT(with, 1.0) << "distances should fall";
}

TEST_F(PostRun, DrawsDependOnTheContextAndOnNothingElse) {
  StructuredLatentAutoEncoderStageOptions options = stage_options();
  options.noise_skl = {true, 1.0, 0.75, 0};
  const auto made = stage(options);
  const auto batch = made->data().load({{0, 0}});
  const torch::NoGradGuard no_grad;
  const auto loss = [&](const LossContext& context) {
    torch::randn({3});  // moves LibTorch's own generator
    return made->losses(*batch, context).total.item<double>();
  };
  const double first = loss({7, 3, 0});
  EXPECT_EQ(loss({7, 3, 0}), first);
  EXPECT_NE(loss({8, 3, 0}), first);
  EXPECT_NE(loss({7, 4, 0}), first);
  EXPECT_NE(loss({7, 3, 1}), first);
}

TEST_F(PostRun, ABudgetOfMemoryChangesNoLoss) {
  StructuredLatentAutoEncoderStageOptions options = stage_options();
  const auto plain = stage(options);
  options.memory_budget_mb = 1;
  const auto thrifty = stage(options);
  ASSERT_GT(activation_bytes(coders().encoder, coders().decoder, 80, 72), 1 << 20);
  const auto batch = plain->data().load({{0, 0}});
  const auto of = [&](StructuredLatentAutoEncoderStage& made) {
    const Losses losses = made.losses(*batch, {1, 1, 0});
    losses.total.backward();
    double norm = 0.0;
    for (const torch::Tensor& parameter : made.decoder()->parameters()) {
      if (parameter.grad().defined()) norm += parameter.grad().square().sum().item<double>();
    }
    return std::make_pair(losses.total.item<double>(), norm);
  };
  const auto [loss, gradient] = of(*plain);
  const auto [loss_again, gradient_again] = of(*thrifty);
  EXPECT_EQ(loss, loss_again);
  EXPECT_NEAR(gradient, gradient_again, 1e-5 * gradient) << "sums of gradients in another order";
}

TEST_F(PostRun, BadConfigsNameTheKey) {
  const auto expect = [&](const std::vector<std::string>& overrides, const std::string& part) {
    const std::string text = message(overrides);
    EXPECT_NE(text.find(part), std::string::npos) << text;
  };
  expect({"trainer.args.depth_loss_type=l3"}, "depth_loss_type");
  expect({"trainer.args.lambda_joint=3"}, "lambda_joints");
  expect({"trainer.args.confidence=bayesian"}, "jp_hyper_continuous");
  expect({"trainer.args.confidence=none"}, "contradicts");
  expect({"trainer.args.normalization=l1", "models.encoder.args.normalize_z=false"}, "normalize_z");
  expect({"trainer.args.lambda_lpips=0.2"}, "lpips_weights");
  expect({"models.decoder.args.representation_config.use_color=false"}, "use_color");
  expect({"models.decoder.args.latent_channels=5"}, "/models/decoder/args/latent_channels");
  expect({"models.decoder.args.skin_decoder_config.skin_feat_channels=6"}, "skin_feat_channels");
  expect({"models.encoder.args.in_channels=7"}, "/models/encoder/args/in_channels");
  expect({"models.encoder.args.resolution=32", "models.decoder.args.resolution=32"}, "resolution");
  expect({"dataset.name=AniGenSLat"}, "AniGenSparseFeat2Skeleton");
}

TEST_F(PostRun, SamplesArePictures) {
  train(command("run", {"trainer.args.max_steps=1", "trainer.args.i_sample=1", "trainer.args.i_save=0"}));
  EXPECT_TRUE(fs::exists(folder_ / "run/samples/step1/reconstructions.png"));
}

}  // namespace
}  // namespace anigen::train
