#include <gtest/gtest.h>
#include <cmath>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/vision/dinov2.h"
#include "tests/io/arrays/array_file_bytes.h"
#include "tests/support/paths.h"
#include "tests/vision/deterministic_fill.h"

namespace anigen::vision {

namespace {

Dinov2Options tiny(std::int64_t depth = 1, std::int64_t registers = 2, const std::string& ffn = "mlp") {
  Dinov2Options options;
  options.img_size = 12;
  options.patch_size = 4;
  options.embed_dim = 8;
  options.depth = depth;
  options.num_heads = 2;
  options.ffn_layer = ffn;
  options.num_register_tokens = registers;
  return options;
}

Dinov2 filled(const Dinov2Options& options) {
  Dinov2 model(options);
  test::golden_fill(*model);
  return model;
}

Tensor entry(const Dinov2& model, const std::string& key) {
  for (const nn::StateEntry& entry : nn::state_entries(*model)) {
    if (entry.key == key) return entry.tensor.detach();
  }
  throw std::runtime_error("no entry " + key);
}

TEST(Dinov2Options, NamesOfThePublishedModels) {
  EXPECT_EQ(Dinov2Options::names().size(), 8u);
  const Dinov2Options large = Dinov2Options::named("dinov2_vitl14_reg");
  EXPECT_EQ(large.embed_dim, 1024);
  EXPECT_EQ(large.depth, 24);
  EXPECT_EQ(large.num_heads, 16);
  EXPECT_EQ(large.num_register_tokens, 4);
  EXPECT_TRUE(large.interpolate_antialias);
  EXPECT_EQ(large.interpolate_offset, 0.0);
  EXPECT_EQ(large.patches_per_side(), 37);
  const Dinov2Options giant = Dinov2Options::named("dinov2_vitg14");
  EXPECT_EQ(giant.num_register_tokens, 0);
  EXPECT_FALSE(giant.interpolate_antialias);
  EXPECT_EQ(giant.interpolate_offset, 0.1);
  EXPECT_EQ(giant.ffn_hidden(), 4096);  // two thirds of 6,144
  try {
    Dinov2Options::named("dinov2_vitl14_regs");
    FAIL() << "no error";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("dinov2_vitl14_reg'"), std::string::npos) << error.what();
  }
}

TEST(Dinov2Options, JsonRoundTripAndRefusals) {
  const Dinov2Options options = tiny(3, 5, "swiglufused");
  EXPECT_EQ(Dinov2Options::from_json(options.to_json()).to_json(), options.to_json());
  const auto refused = [](const char* json) {
    EXPECT_THROW(Dinov2Options::from_json(parse_json(json, "test")), InputError) << json;
  };
  refused(R"({"num_heads": 3})");
  refused(R"({"img_size": 4})");
  refused(R"({"ffn_layer": "identity"})");
  refused(R"({"depht": 3})");
  refused(R"({"embed_dim": 1e9})");
  EXPECT_THROW(Dinov2Options::from_json(parse_json(R"({"block_chunks": 4})", "test")), NotSupportedError);
}

TEST(Dinov2, GiantHasPublishedKeysAndShapes) {
  Dinov2Options options = Dinov2Options::named("dinov2_vitg14");
  options.depth = 1;
  const Dinov2 model(options);
  EXPECT_EQ(entry(model, "blocks.0.mlp.w12.weight").sizes(), (std::vector<std::int64_t>{8192, 1536}));
  EXPECT_EQ(entry(model, "blocks.0.mlp.w12.bias").sizes(), (std::vector<std::int64_t>{8192}));
  EXPECT_EQ(entry(model, "blocks.0.mlp.w3.weight").sizes(), (std::vector<std::int64_t>{1536, 4096}));
  EXPECT_EQ(entry(model, "pos_embed").sizes(), (std::vector<std::int64_t>{1, 1370, 1536}));
  EXPECT_THROW(entry(model, "register_tokens"), std::runtime_error);
}

TEST(Dinov2, TokensAreClassRegistersPatchesAndOnlyRegistersLackAPosition) {
  const torch::NoGradGuard no_grad;
  Dinov2 model = filled(tiny(0));
  const Tensor image = test::golden_tensor(7, {1, 3, 12, 12});
  const Tensor tokens = model->tokens_after(image, 0)[0];
  ASSERT_EQ(tokens.size(0), 1 + 2 + 9);
  const Tensor positions = entry(model, "pos_embed")[0];
  EXPECT_TRUE(torch::allclose(tokens[0], entry(model, "cls_token")[0][0] + positions[0]));
  EXPECT_TRUE(torch::allclose(tokens.slice(0, 1, 3), entry(model, "register_tokens")[0]));
  // The patch in row 1, column 2: all its pixels against the weights, by hand.
  const Tensor patch = image[0].slice(1, 4, 8).slice(2, 8, 12);
  const Tensor mapped = (entry(model, "patch_embed.proj.weight") * patch).sum(torch::IntArrayRef{1, 2, 3}) +
                        entry(model, "patch_embed.proj.bias");
  EXPECT_TRUE(torch::allclose(tokens[3 + 5], mapped + positions[1 + 5], 1e-5, 1e-6));
}

TEST(Dinov2, NormsAndSlices) {
  const torch::NoGradGuard no_grad;
  Dinov2 model = filled(tiny(2));
  const Dinov2Tokens tokens = model->forward(test::golden_tensor(7, {2, 3, 8, 16}));
  EXPECT_EQ(tokens.rows, 2);
  EXPECT_EQ(tokens.columns, 4);
  EXPECT_EQ(tokens.norm_class().sizes(), (std::vector<std::int64_t>{2, 8}));
  EXPECT_EQ(tokens.norm_registers().size(1), 2);
  EXPECT_EQ(tokens.norm_patches().size(1), 8);
  const Tensor x = tokens.x_prenorm;
  const Tensor centered = x - x.mean(-1, true);
  const Tensor normed = centered / (centered.square().mean(-1, true) + 1e-6).sqrt() * entry(model, "norm.weight") +
                        entry(model, "norm.bias");
  EXPECT_TRUE(torch::allclose(tokens.x_norm, normed, 1e-4, 1e-5));
}

TEST(Dinov2, PicturesOfABatchDoNotMeet) {
  const torch::NoGradGuard no_grad;
  Dinov2 model = filled(tiny(2));
  const Tensor images = test::golden_tensor(7, {3, 3, 12, 12});
  const Tensor together = model->forward(images).x_prenorm;
  for (std::int64_t i = 0; i < 3; ++i) {
    EXPECT_TRUE(
        torch::allclose(together.slice(0, i, i + 1), model->forward(images.slice(0, i, i + 1)).x_prenorm, 1e-4, 1e-5));
  }
}

TEST(Dinov2, RefusesSidesThatAreNoMultipleOfThePatch) {
  Dinov2 model = filled(tiny());
  EXPECT_THROW(model->forward(torch::zeros({1, 3, 12, 13})), c10::Error);
  EXPECT_THROW(model->forward(torch::zeros({1, 4, 12, 12})), c10::Error);
}

TEST(Dinov2FeedForward, SwiGluGatesWithTheFirstHalf) {
  const torch::NoGradGuard no_grad;
  const Dinov2Options options = tiny(1, 0, "swiglufused");
  ASSERT_EQ(options.ffn_hidden(), 24);  // 8 · 4 · 2/3 = 21.3, rounded up to a multiple of 8
  Dinov2FeedForward part(options);
  test::golden_fill(*part);
  const Tensor x = test::golden_tensor(5, {3, 8}, 2.0);
  const std::vector<nn::StateEntry> entries = nn::state_entries(*part);
  ASSERT_EQ(entries[0].key, "w12.weight");
  const Tensor gate = torch::mm(x, entries[0].tensor.slice(0, 0, 24).t()) + entries[1].tensor.slice(0, 0, 24);
  const Tensor value = torch::mm(x, entries[0].tensor.slice(0, 24).t()) + entries[1].tensor.slice(0, 24);
  const Tensor expected = torch::mm(gate / (1 + (-gate).exp()) * value, entries[2].tensor.t()) + entries[3].tensor;
  EXPECT_TRUE(torch::allclose(part->forward(x), expected, 1e-4, 1e-5));
}

TEST(Dinov2Positions, OwnSizeIsTheParameterItself) {
  const Tensor embedding = test::golden_tensor(1, {1, 1 + 25, 4});
  EXPECT_TRUE(interpolate_positions(embedding, 5, 5, false, 0.1).is_same(embedding));
  EXPECT_TRUE(interpolate_positions(embedding, 5, 5, true, 0.0).is_same(embedding));
}

TEST(Dinov2Positions, KeepsTheClassTokenAndConstants) {
  Tensor embedding = torch::full({1, 1 + 25, 2}, 3.0F);
  embedding[0][0].fill_(7.0F);
  for (const bool antialias : {false, true}) {
    for (const double offset : {0.0, 0.1}) {
      const Tensor found = interpolate_positions(embedding, 3, 8, antialias, offset);
      ASSERT_EQ(found.sizes(), (std::vector<std::int64_t>{1, 1 + 24, 2}));
      EXPECT_TRUE(torch::equal(found[0][0], embedding[0][0]));
      EXPECT_LT((found.slice(1, 1) - 3.0).abs().max().item<float>(), 1e-5F);
    }
  }
}

// On a ramp along the rows, cubic convolution with a = -0.75 gives floor(p) + 1.5 t² ... by the weights of its four
// samples; p tells which scale the kernel used.
TEST(Dinov2Positions, OffsetChangesTheSamplingPlaces) {
  constexpr std::int64_t kSide = 16, kRows = 8;
  const Tensor ramp = torch::arange(kSide, torch::kFloat32).view({kSide, 1}).expand({kSide, kSide}).reshape({-1, 1});
  const Tensor embedding = torch::cat({torch::zeros({1, 1}), ramp}, 0).unsqueeze(0);
  const Tensor found = interpolate_positions(embedding, kRows, kSide, false, 0.1).slice(1, 1).view({kRows, kSide});
  const Tensor by_size = interpolate_positions(embedding, kRows, kSide, false, 0.0).slice(1, 1).view({kRows, kSide});
  for (std::int64_t i = 1; i + 1 < kRows; ++i) {
    const auto expected = [&](double scale) {
      const double p = (static_cast<double>(i) + 0.5) * scale - 0.5, t = p - std::floor(p), a = -0.75;
      return std::floor(p) - (4 * a + 2) * t * t * t + (6 * a + 3) * t * t - 2 * a * t;
    };
    EXPECT_NEAR(found[i][5].item<double>(), expected(kSide / (kRows + 0.1)), 1e-4);
    EXPECT_NEAR(by_size[i][5].item<double>(), expected(2.0), 1e-4);
  }
}

TEST(ImagenetNormalized, TakesEachChannelsMeanAndDeviation) {
  const Tensor image = torch::ones({1, 3, 2, 2});
  const Tensor found = imagenet_normalized(image);
  EXPECT_NEAR(found[0][0][1][1].item<double>(), (1 - 0.485) / 0.229, 1e-5);
  EXPECT_NEAR(found[0][1][0][1].item<double>(), (1 - 0.456) / 0.224, 1e-5);
  EXPECT_NEAR(found[0][2][1][0].item<double>(), (1 - 0.406) / 0.225, 1e-5);
}

}  // namespace

namespace {

Dinov2Options tiny_weights(std::int64_t channels = 8, std::int64_t registers = 2) {
  Dinov2Options options;
  options.img_size = 12;
  options.patch_size = 4;
  options.embed_dim = channels;
  options.depth = 1;
  options.num_heads = 2;
  options.num_register_tokens = registers;
  return options;
}

class Dinov2Weights : public testing::Test {
 protected:
  Dinov2Weights() : model_(tiny_weights()) {
    test::golden_fill(*model_);
    weights_ = nn::state_dict(*model_);
  }

  std::filesystem::path written(const io::NamedArrays& arrays) {
    io::write_safetensors(folder_ / "weights.safetensors", arrays);
    return folder_ / "weights.safetensors";
  }

  // Report of loading into a fresh model.
  std::string refusal(const std::filesystem::path& file, const Dinov2Options& options = tiny_weights()) {
    Dinov2 model(options);
    try {
      load_dinov2_weights(model, file);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }

  io::NdArray& weight(const std::string& key) {
    for (auto& [name, array] : weights_) {
      if (name == key) return array;
    }
    throw std::runtime_error("no weight " + key);
  }

  void expect_same(const Dinov2& loaded) {
    const std::vector<nn::StateEntry> wanted = nn::state_entries(*model_), found = nn::state_entries(*loaded);
    ASSERT_EQ(found.size(), wanted.size());
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      EXPECT_TRUE(torch::equal(found[i].tensor, wanted[i].tensor)) << wanted[i].key;
      EXPECT_FALSE(found[i].tensor.requires_grad());
    }
  }

  test::TemporaryFolder folder_;
  Dinov2 model_;
  io::NamedArrays weights_;
};

void expect_mentions(const std::string& message, const std::vector<std::string>& words) {
  for (const std::string& word : words) EXPECT_NE(message.find(word), std::string::npos) << word << " in: " << message;
}

TEST_F(Dinov2Weights, LoadsSafetensors) {
  Dinov2 loaded(tiny_weights());
  load_dinov2_weights(loaded, written(weights_));
  expect_same(loaded);
  EXPECT_FALSE(loaded->is_training());
}

// The bytes of torch.save of an OrderedDict of fp32 tensors, one storage each.
std::string saved_by_torch(const io::NamedArrays& weights) {
  test::PickleBuilder pickle;
  pickle.global("collections", "OrderedDict").op(")").reduce().mark();
  std::vector<std::pair<std::string, std::string>> members = {{"weights/data.pkl", ""}};
  for (const auto& [key, array] : weights) {
    const std::string storage = std::to_string(members.size() - 1);
    pickle.text(key).global("torch._utils", "_rebuild_tensor_v2").mark().mark();
    pickle.text("storage").global("torch", "FloatStorage").text(storage).text("cpu");
    pickle.integer(static_cast<int>(array.count())).tuple().op("Q").integer(0).mark();
    for (const std::int64_t size : array.shape) pickle.integer(static_cast<int>(size));
    pickle.tuple().mark();
    auto stride = static_cast<int>(array.count());
    for (const std::int64_t size : array.shape) pickle.integer(stride /= static_cast<int>(size));
    pickle.tuple().boolean(false).global("collections", "OrderedDict").op(")").reduce().tuple().reduce();
    members.emplace_back("weights/data/" + storage, std::string(array.bytes.begin(), array.bytes.end()));
  }
  members.front().second = pickle.op("u").stop();
  members.emplace_back("weights/version", "3\n");
  return test::stored_zip(members);
}

TEST_F(Dinov2Weights, LoadsWhatTorchSaves) {
  const std::string bytes = saved_by_torch(weights_);
  write_file_atomically(folder_ / "weights.pth", bytes);
  Dinov2 loaded(tiny_weights());
  load_dinov2_weights(loaded, folder_ / "weights.pth");
  expect_same(loaded);

  for (const std::size_t length : {bytes.size() / 2, bytes.size() - 1}) {
    write_file_atomically(folder_ / "cut.pth", bytes.substr(0, length));
    expect_mentions(refusal(folder_ / "cut.pth"), {"cut.pth"});
  }
}

// The other published form: Hugging Face's names, queries, keys and values apart.
io::NamedArrays in_transformers_form(const io::NamedArrays& weights) {
  const std::vector<std::pair<std::string, std::string>> names = {
      {"cls_token", "embeddings.cls_token"},
      {"pos_embed", "embeddings.position_embeddings"},
      {"register_tokens", "embeddings.register_tokens"},
      {"mask_token", "embeddings.mask_token"},
      {"patch_embed.proj", "embeddings.patch_embeddings.projection"},
      {"blocks.0.attn.proj", "encoder.layer.0.attention.output.dense"},
      {"blocks.0.ls1.gamma", "encoder.layer.0.layer_scale1.lambda1"},
      {"blocks.0.ls2.gamma", "encoder.layer.0.layer_scale2.lambda1"},
      {"blocks.0.mlp.w12", "encoder.layer.0.mlp.weights_in"},
      {"blocks.0.mlp.w3", "encoder.layer.0.mlp.weights_out"},
      {"blocks.0", "encoder.layer.0"},
      {"norm", "layernorm"}};
  io::NamedArrays other;
  for (const auto& [key, array] : weights) {
    const std::string qkv = "blocks.0.attn.qkv.";
    if (key.compare(0, qkv.size(), qkv) == 0) {
      const std::vector<Tensor> parts = nn::to_tensor(array).chunk(3, 0);
      const std::vector<std::string> kinds = {"query", "key", "value"};
      for (std::size_t i = 0; i < 3; ++i) {
        other.emplace_back("encoder.layer.0.attention.attention." + kinds[i] + "." + key.substr(qkv.size()),
                           nn::to_array(parts[i]));
      }
      continue;
    }
    for (const auto& [hub, transformers] : names) {
      if (key.compare(0, hub.size(), hub) != 0) continue;
      other.emplace_back(transformers + key.substr(hub.size()), array);
      break;
    }
  }
  return other;
}

TEST_F(Dinov2Weights, LoadsTheKeysOfTransformers) {
  Dinov2 loaded(tiny_weights());
  load_dinov2_weights(loaded, written(in_transformers_form(weights_)));
  expect_same(loaded);

  io::NamedArrays lacking = in_transformers_form(weights_);
  for (auto& [key, array] : lacking) {
    if (key == "encoder.layer.0.attention.attention.key.bias") key = "elsewhere";
  }
  expect_mentions(refusal(written(lacking)), {"missing", "blocks.0.attn.qkv.bias"});
}

TEST_F(Dinov2Weights, LoadsTheKeysOfTransformersWithSwiGlu) {
  Dinov2Options options = tiny_weights();
  options.ffn_layer = "swiglufused";
  model_ = Dinov2(options);
  test::golden_fill(*model_);
  Dinov2 loaded(options);
  load_dinov2_weights(loaded, written(in_transformers_form(nn::state_dict(*model_))));
  expect_same(loaded);
}

TEST_F(Dinov2Weights, RefusesTruncatedMissingAndForeignFiles) {
  const std::string bytes = read_file(written(weights_));
  for (const std::size_t length : {std::size_t{0}, std::size_t{5}, bytes.size() / 3, bytes.size() - 1}) {
    write_file_atomically(folder_ / "cut.safetensors", bytes.substr(0, length));
    expect_mentions(refusal(folder_ / "cut.safetensors"), {"cut.safetensors"});
  }
  expect_mentions(refusal(folder_ / "absent.pth"), {"absent.pth"});
  write_file_atomically(folder_ / "weights.bin", bytes);
  expect_mentions(refusal(folder_ / "weights.bin"), {"weights.bin"});
}

TEST_F(Dinov2Weights, AnotherSizeNamesTheKeyAndBothShapes) {
  expect_mentions(refusal(written(weights_), tiny_weights(16)), {"cls_token", "[1, 1, 8]", "[1, 1, 16]"});
}

TEST_F(Dinov2Weights, RegistersMustMatch) {
  expect_mentions(refusal(written(weights_), tiny_weights(8, 0)), {"unexpected", "register_tokens"});
  weights_.erase(weights_.begin() + 2);
  expect_mentions(refusal(written(weights_)), {"missing", "register_tokens"});
}

TEST_F(Dinov2Weights, RefusesNumbersThatAreNotFinite) {
  Tensor norm = nn::to_tensor(weight("norm.weight"));
  norm[3] = std::nan("");
  weight("norm.weight") = nn::to_array(norm);
  expect_mentions(refusal(written(weights_)), {"weights.safetensors", "norm.weight", "not finite"});
}

TEST_F(Dinov2Weights, RefusesWholeNumbers) {
  weight("norm.bias") = nn::to_array(torch::zeros({8}, torch::kInt64));
  expect_mentions(refusal(written(weights_)), {"norm.bias", "int64"});
}

}  // namespace

}  // namespace anigen::vision
