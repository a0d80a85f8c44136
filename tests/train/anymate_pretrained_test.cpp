#include "anigen/train/anymate_pretrained.h"

#include <gtest/gtest.h>

#include <fstream>
#include <map>

#include "anigen/core/error.h"
#include "anigen/io/safetensors.h"
#include "anigen/models/state_dict.h"
#include "anigen/models/tensor_arrays.h"
#include "tests/support/paths.h"

namespace anigen::train {
namespace {

namespace fs = std::filesystem;
namespace anymate = models::anymate;
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
  for (const models::StateEntry& entry : models::state_entries(*model))
    state[entry.key] = entry.tensor.detach().clone();
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
    arrays.emplace_back(theirs(key), models::to_array(drawn));
  }
  return arrays;
}

std::string point_llm_name(const std::string& key) { return "model.point_backbone." + key.substr(8); }
std::string michelangelo_name(const std::string& key) {
  return key == "encoder.shape_projection" ? "model.shape_projection" : "model.shape_model." + key.substr(8);
}

// Keys of the files of others, literally (reference anymate-baselines.md, 2.2 and 2.3).
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
  first.emplace_back("lm_head.weight", models::to_array(torch::randn({50, 8})));
  second.emplace_back("model.layers.0.mlp.weight", models::to_array(torch::randn({8, 8})));
  io::write_safetensors(folder / "model-00001-of-00002.safetensors", first);
  io::write_safetensors(folder / "model-00002-of-00002.safetensors", second);
  // What lies beside the parts of a large model is not looked into.
  std::ofstream(folder / "training_args.bin") << "not weights";
  std::ofstream(folder / "pytorch_model-00001-of-00002.bin") << "the same in another format";

  torch::manual_seed(1);
  anymate::AnymateModel model(small("bert"));
  const auto before = state_of(model);
  load_pretrained_encoder(*model, folder.path());
  const auto after = state_of(model);
  for (const auto& [name, array] : arrays) {
    const std::string key = "encoder." + name.substr(std::string("model.point_backbone.").size());
    EXPECT_TRUE(torch::equal(after.at(key), models::to_tensor(array))) << key;
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
    narrow = models::to_tensor(array).narrow(1, 0, 54).contiguous();
    array = models::to_array(narrow);
  }
  ASSERT_TRUE(narrow.defined());
  arrays.emplace_back("model.shape_model.geo_decoder.ln.weight", models::to_array(torch::ones({24})));
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
      EXPECT_TRUE(torch::equal(after.at("encoder.shape_projection"), models::to_tensor(array)));
    }
  }
}

TEST(AnymatePretrained, WhatIsMissingIsNamedAndNothingIsLoaded) {
  const test::TemporaryFolder folder;
  io::NamedArrays arrays = foreign_weights("bert", point_llm_name);
  const std::string lost = arrays.back().first;
  arrays.pop_back();
  io::write_safetensors(folder / "part.safetensors", arrays);
  io::write_safetensors(folder / "other.safetensors", {{"weight", models::to_array(torch::ones({3}))}});

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
}  // namespace anigen::train
