#include <gtest/gtest.h>
#include <cmath>
#include <fstream>
#include <map>

#include "anigen/anymate/dataset.h"
#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/table.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/train/stages/anymate.h"
#include "anigen/train/train_command.h"
#include "anigen/train/trainer_state.h"
#include "tests/data/synthetic_dataset.h"
#include "tests/support/paths.h"
#include "tests/train/stages/run_folder.h"

namespace anigen::train {

namespace {

namespace fs = std::filesystem;
using torch::Tensor;

anymate::ModelOptions small(const std::string& encoder) {
  Json args = Json::parse(R"({"decoder": "transformer_latent", "num_joints": 4, "width": 24, "heads": 2, "layers": 1,
    "bert": {"trans_dim": 12, "depth": 1, "num_heads": 2, "num_group": 6, "group_size": 5, "encoder_dims": 16,
             "projection_1": 16, "projection_2": 16},
    "michelangelo": {"num_latents": 5, "width": 24, "heads": 2, "embed_dim": 4, "num_encoder_layers": 1,
                     "num_decoder_layers": 1},
    "scratch": {"num_latents": 4, "width": 24, "heads": 2, "num_encoder_layers": 1}})");
  args["encoder"] = encoder;
  return anymate::ModelOptions::from_json(args, "test");
}

std::map<std::string, Tensor> state_of(const anymate::AnymateModel& model) {
  std::map<std::string, Tensor> state;
  for (const nn::StateEntry& entry : nn::state_entries(*model)) state[entry.key] = entry.tensor.detach().clone();
  return state;
}

// The encoder of another model of the same kind, under the names that `theirs` gives.
template <typename Theirs>
io::NamedArrays foreign_weights(const std::string& encoder, const Theirs& theirs) {
  torch::manual_seed(77);
  io::NamedArrays arrays;
  for (const auto& [key, tensor] : state_of(anymate::AnymateModel(small(encoder)))) {
    if (key.rfind("encoder.", 0) != 0) continue;
    const Tensor drawn = tensor.is_floating_point() ? torch::randn(tensor.sizes()) : tensor;
    arrays.emplace_back(theirs(key), nn::to_array(drawn));
  }
  return arrays;
}

std::string point_llm_name(const std::string& key) { return "model.point_backbone." + key.substr(8); }
std::string michelangelo_name(const std::string& key) {
  return key == "encoder.shape_projection" ? "model.shape_projection" : "model.shape_model." + key.substr(8);
}

// Keys of the files of others, literally (docs/reference/anymate.md, 2.2 and 2.3).
TEST(AnymatePretrained, NamesAreTheirs) {
  const auto has = [](const io::NamedArrays& arrays, const std::string& key) {
    return io::find(arrays, key) != nullptr;
  };
  const io::NamedArrays bert = foreign_weights("bert", point_llm_name);
  for (const char* key : {"cls_token", "encoder.first_conv.1.running_mean", "blocks.blocks.0.attn.qkv.weight",
                          "pos_embed.2.bias", "reduce_dim.weight", "norm.bias"}) {
    EXPECT_TRUE(has(bert, std::string("model.point_backbone.") + key)) << key;
  }
  const io::NamedArrays miche = foreign_weights("miche", michelangelo_name);
  for (const char* key :
       {"model.shape_projection", "model.shape_model.encoder.input_proj.weight", "model.shape_model.encoder.query",
        "model.shape_model.pre_kl.weight", "model.shape_model.transformer.resblocks.0.attn.c_qkv.weight"}) {
    EXPECT_TRUE(has(miche, key)) << key;
  }
}

TEST(AnymatePretrained, PointBertFromThePartsOfALargeModel) {
  const test::TemporaryFolder folder;
  const io::NamedArrays arrays = foreign_weights("bert", point_llm_name);
  const auto half = arrays.begin() + static_cast<std::ptrdiff_t>(arrays.size() / 2);
  io::NamedArrays first(arrays.begin(), half), second(half, arrays.end());
  first.emplace_back("lm_head.weight", nn::to_array(torch::randn({50, 8})));
  second.emplace_back("model.layers.0.mlp.weight", nn::to_array(torch::randn({8, 8})));
  io::write_safetensors(folder / "model-00001-of-00002.safetensors", first);
  io::write_safetensors(folder / "model-00002-of-00002.safetensors", second);
  // Files beside the parts of a large model are not read.
  std::ofstream(folder / "training_args.bin") << "not weights";
  std::ofstream(folder / "pytorch_model-00001-of-00002.bin") << "the same in another format";

  torch::manual_seed(1);
  anymate::AnymateModel model(small("bert"));
  const auto before = state_of(model);
  load_pretrained_encoder(*model, folder.path());
  const auto after = state_of(model);
  for (const auto& [name, array] : arrays) {
    const std::string key = "encoder." + name.substr(std::string("model.point_backbone.").size());
    EXPECT_TRUE(torch::equal(after.at(key), nn::to_tensor(array))) << key;
  }
  for (const auto& [key, tensor] : before) {
    if (key.rfind("encoder.", 0) != 0) {
      EXPECT_TRUE(torch::equal(after.at(key), tensor)) << key;
    }
  }
}

TEST(AnymatePretrained, MichelangelosInputIsWidened) {
  const test::TemporaryFolder folder;
  io::NamedArrays arrays = foreign_weights("miche", michelangelo_name);
  Tensor narrow;
  for (auto& [name, array] : arrays) {
    if (name != "model.shape_model.encoder.input_proj.weight") continue;
    narrow = nn::to_tensor(array).narrow(1, 0, 54).contiguous();
    array = nn::to_array(narrow);
  }
  ASSERT_TRUE(narrow.defined());
  arrays.emplace_back("model.shape_model.geo_decoder.ln.weight", nn::to_array(torch::ones({24})));
  io::write_safetensors(folder / "shapevae.safetensors", arrays);

  anymate::AnymateModel model(small("miche"));
  const Tensor own = state_of(model).at("encoder.encoder.input_proj.weight");
  load_pretrained_encoder(*model, folder / "shapevae.safetensors");
  const auto after = state_of(model);
  const Tensor& wide = after.at("encoder.encoder.input_proj.weight");
  ASSERT_EQ(wide.size(1), 79);
  EXPECT_TRUE(torch::equal(wide.narrow(1, 0, 54), narrow));
  EXPECT_TRUE(torch::equal(wide.narrow(1, 54, 25), own.narrow(1, 54, 25)));
  for (const auto& [name, array] : arrays) {
    if (name == "model.shape_projection") {
      EXPECT_TRUE(torch::equal(after.at("encoder.shape_projection"), nn::to_tensor(array)));
    }
  }
}

TEST(AnymatePretrained, WhatIsMissingIsNamedAndNothingIsLoaded) {
  const test::TemporaryFolder folder;
  io::NamedArrays arrays = foreign_weights("bert", point_llm_name);
  const std::string lost = arrays.back().first;
  arrays.pop_back();
  io::write_safetensors(folder / "part.safetensors", arrays);
  io::write_safetensors(folder / "other.safetensors", {{"weight", nn::to_array(torch::ones({3}))}});

  anymate::AnymateModel model(small("bert")), scratch(small("transformer"));
  const auto before = state_of(model);
  const auto message = [&](anymate::AnymateModel& into, const fs::path& path) -> std::string {
    try {
      load_pretrained_encoder(*into, path);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_NE(message(model, folder / "part.safetensors").find(lost.substr(lost.rfind('.') + 1)), std::string::npos);
  EXPECT_NE(message(model, folder / "other.safetensors").find("model.point_backbone."), std::string::npos);
  EXPECT_NE(message(model, folder / "nothing.safetensors").find("nothing.safetensors"), std::string::npos);
  EXPECT_NE(message(scratch, folder / "part.safetensors").find("not supported"), std::string::npos);
  fs::create_directory(folder / "empty");
  EXPECT_NE(message(model, folder / "empty").find("pretrained_encoder"), std::string::npos);
  for (const auto& [key, tensor] : state_of(model)) EXPECT_TRUE(torch::equal(before.at(key), tensor)) << key;
}

}  // namespace

namespace {

namespace fs = std::filesystem;

constexpr char kAnymateConfig[] = R"({
  "models": {"model": {"name": "AnymateModel", "args": {
    "encoder": "bert", "decoder": "transformer_latent", "num_joints": 12, "width": 24, "heads": 2, "init_scale": 0.1,
    "layers": 2, "concat_denoiser": {"width": 24, "heads": 2},
    "num_z": 3, "num_latents": 4, "z_dim": 24, "x_dim": 16, "num_blocks": 1, "num_compute_layers": 1, "num_heads": 2,
    "triplane": {"z_dim": 24, "w_dim": 24, "img_resolution": 16, "channel_base": 64, "channel_max": 8},
    "token_layers": 1, "head_token_length": 6, "concat_skinning": {"layers": 1, "concat_num": 16},
    "bert": {"trans_dim": 12, "depth": 1, "num_heads": 2, "num_group": 6, "group_size": 5, "encoder_dims": 16,
             "projection_1": 16, "projection_2": 16},
    "michelangelo": {"num_latents": 5, "width": 24, "heads": 2, "embed_dim": 4, "num_encoder_layers": 1,
                     "num_decoder_layers": 1},
    "scratch": {"num_latents": 4, "width": 24, "heads": 2, "num_encoder_layers": 1}}}},
  "dataset": {"name": "Anymate", "args": {"points": 64, "eval_fraction": 0.4}},
  "trainer": {"name": "AnymateTrainer", "args": {
    "max_steps": 6, "batch_size": 3, "seed": 5, "num_train_step": 10, "num_training_points": 16, "skin_points": 32,
    "optimizer": {"name": "Adam", "args": {"lr": 0.003, "weight_decay": 1e-5}},
    "lr_scheduler": {"name": "MultiStepLR", "args": {"milestones": ["50%"], "gamma": 0.2}},
    "ema_rate": [0.9], "fp16_mode": "none", "i_log": 1, "i_print": 0, "i_save": 3, "i_eval": 6, "i_sample": 0}}})";

class AnymateRun : public ::testing::Test {
 protected:
  void SetUp() override {
    test::write_synthetic_dataset(folder_ / "data", 10);
    std::ofstream(folder_ / "config.json") << kAnymateConfig;
  }
  static std::vector<std::string> of(const std::string& encoder, const std::string& decoder) {
    return {"models.model.args.encoder=" + encoder, "models.model.args.decoder=" + decoder};
  }
  // The last value of every column.
  std::map<std::string, double> last_values(const std::string& output) {
    const CsvTable table = read_csv(folder_ / output / "metrics.csv");
    std::map<std::string, double> row;
    for (std::size_t c = 0; c < table.columns.size(); ++c) {
      for (const std::vector<std::string>& cells : table.rows) {
        if (!cells[c].empty()) row[table.columns[c]] = std::stod(cells[c]);
      }
    }
    return row;
  }
  test::TemporaryFolder folder_;
};

struct Case {
  const char *encoder, *decoder, *loss, *metric;
};

TEST_F(AnymateRun, EveryDecoderTrainsAndIsEvaluated) {
  const Case cases[] = {{"bert", "transformer_latent", "chamfer", "cd"},
                        {"miche", "transformer_latent", "chamfer", "cd"},
                        {"bert", "Pointe_Diffusion", "mse", "joints"},
                        {"miche", "Cross_Attention_Diffusion", "mse", "joints"},
                        {"transformer", "implicit_transformer", "bce", "joints"},
                        {"bert", "triplane", "bce", "joints"},
                        {"bert", "attendjoints_con_combine", "ce", "precision"},
                        {"miche", "attendjoints_con_token", "ce", "tree_recall"},
                        {"bert", "attendjoints_combine", "cos_clamp", "cos"},
                        {"transformer", "attendjoints_multi", "cos_clamp", "l1"}};
  for (const Case& one : cases) {
    const std::string output = std::string(one.encoder) + "-" + one.decoder;
    train(test::train_command(folder_, output, of(one.encoder, one.decoder)));
    const auto row = last_values(output);
    const auto loss = row.find(std::string("loss.") + one.loss);
    ASSERT_NE(loss, row.end()) << output;
    EXPECT_TRUE(std::isfinite(loss->second)) << output;
    bool has_metric = false;
    for (const auto& [name, value] : row)
      has_metric |= name.find(one.metric) != std::string::npos && std::isfinite(value);
    EXPECT_TRUE(has_metric) << output << " has no " << one.metric;
  }
}

// "paper" changes the loss and the sides of a connectivity's matrix; "published" nothing, bit for bit.
TEST_F(AnymateRun, ThePapersConnectivityIsASwitch) {
  const auto run = [&](const std::string& output, const std::string& decoder, const std::string& more) {
    std::vector<std::string> overrides = of("bert", decoder);
    if (!more.empty()) overrides.push_back(more);
    train(test::train_command(folder_, output, overrides));
    return read_file(folder_ / output / "ckpts/model_step0000006.safetensors");
  };
  const std::string plain = run("plain", "attendjoints_con_combine", "");
  EXPECT_EQ(run("published", "attendjoints_con_combine", "trainer.args.compatibility=published"), plain);
  EXPECT_NE(run("paper", "attendjoints_con_combine", "trainer.args.compatibility=paper"), plain);
  EXPECT_EQ(last_values("paper").count("loss.bce"), 1u);
  EXPECT_EQ(last_values("paper").count("loss.ce"), 0u);
  const Json config = read_json(folder_ / "paper/config.json");
  EXPECT_EQ(config["models"]["model"]["args"]["children"], "columns");
  EXPECT_EQ(config["trainer"]["args"]["connectivity_loss"], "bce");
  // Other tasks have one form.
  EXPECT_EQ(run("joints_paper", "transformer_latent", "trainer.args.compatibility=paper"),
            run("joints", "transformer_latent", ""));
}

TEST_F(AnymateRun, SamplingWritesTheMetricsOfEachAsset) {
  std::vector<std::string> skin = of("bert", "attendjoints_combine");
  skin.emplace_back("trainer.args.i_sample=6");
  train(test::train_command(folder_, "skin", skin));
  const CsvTable table = read_csv(folder_ / "skin" / "samples" / "step6" / "scores.csv");
  ASSERT_GT(table.rows.size(), 0u);
  EXPECT_EQ(table.rows.size() % 2, 0u) << "the model and the nearest bone";
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    const double mae = std::stod(table.cell(r, "mae"));
    EXPECT_GE(mae, 0.0);
    EXPECT_LE(mae, 1.0);
    EXPECT_EQ(table.cell(r, "method"), r % 2 == 0 ? "model" : "nearest bone");
  }
}

TEST_F(AnymateRun, RegressionComesNearerToTheJoints) {
  train(test::train_command(folder_, "run",
                            {"trainer.args.max_steps=150", "trainer.args.lr_scheduler=null", "trainer.args.i_eval=0"}));
  const CsvTable table = read_csv(folder_ / "run" / "metrics.csv");
  EXPECT_LT(last_values("run").at("loss.chamfer"), 0.6 * std::stod(table.cell(0, "loss.chamfer")));
}

TEST_F(AnymateRun, ARunThatWasStoppedEndsWithTheSameBits) {
  const std::vector<std::string> model = of("miche", "Pointe_Diffusion");  // draws in encoder, decoder and loss
  train(test::train_command(folder_, "whole", model));
  std::vector<std::string> half = model;
  half.emplace_back("trainer.args.max_steps=3");
  half.emplace_back("trainer.args.lr_scheduler.args.milestones=[3]");
  train(test::train_command(folder_, "parts", half));
  torch::rand({17});  // what else drew must not matter
  train(test::train_command(folder_, "parts", model));
  const auto weights = [&](const std::string& output) {
    return CheckpointFolder(folder_ / output / "ckpts").weights("model", 6);
  };
  const io::NamedArrays whole = weights("whole"), parts = weights("parts");
  ASSERT_EQ(whole.size(), parts.size());
  for (std::size_t i = 0; i < whole.size(); ++i)
    EXPECT_EQ(whole[i].second.bytes, parts[i].second.bytes) << whole[i].first;
}

TEST(AnymateConfigs, ShippedOnesAreWholeAndSmallOnesCanBeBuilt) {
  std::size_t files = 0;
  for (const char* folder : {"anymate", "anymate_tiny"}) {
    for (const auto& entry : fs::directory_iterator(test::source_dir() / "configs" / folder)) {
      const std::string file = entry.path().string();
      Json config = load_config(entry.path());
      const auto model = anymate::ModelOptions::from_json(config["models"]["model"]["args"], file);
      ConfigReader trainer(config["trainer"]["args"], file);
      const auto options = TrainerOptions::read(trainer);
      AnymateStageOptions::read(trainer);
      EXPECT_NO_THROW(trainer.finish()) << file;
      EXPECT_EQ(options.replicas, 1u) << file;
      ConfigReader dataset(config["dataset"]["args"], file);
      anymate::AnymateDatasetOptions::read(dataset);
      EXPECT_NO_THROW(dataset.finish()) << file;
      if (folder == std::string("anymate_tiny")) {
        EXPECT_NO_THROW(anymate::AnymateModel{model}) << file;
      }
      ++files;
    }
  }
  EXPECT_EQ(files, 38u);
}

TEST_F(AnymateRun, BadConfigsNameTheirPlace) {
  const auto message = [&](const std::string& override) -> std::string {
    try {
      train(test::train_command(folder_, "bad", {override}));
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_NE(message("trainer.args.replicas=2").find("replicas"), std::string::npos);
  EXPECT_NE(message("trainer.args.pretrained_encoder=nowhere.bin").find("nowhere.bin"), std::string::npos);
  EXPECT_NE(message("models.model.args.decoder=transformer_laten").find("transformer_latent"), std::string::npos);
  EXPECT_NE(message("models.model.args.bert.dept=2").find("depth"), std::string::npos);
  EXPECT_NE(message("dataset.args.shards=[\"missing.pt\"]").find("data_dir"), std::string::npos);
}

}  // namespace

}  // namespace anigen::train
