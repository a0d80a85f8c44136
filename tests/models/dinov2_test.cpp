#include "anigen/models/dinov2.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/models/dinov2_positions.h"
#include "anigen/models/state_dict.h"
#include "tests/models/deterministic_fill.h"

namespace anigen::models {
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
  for (const StateEntry& entry : state_entries(*model)) {
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
  const std::vector<StateEntry> entries = state_entries(*part);
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
}  // namespace anigen::models
