#include <gtest/gtest.h>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/nn/state_dict.h"
#include "anigen/skin_field/skin_autoencoder.h"
#include "tests/vision/deterministic_fill.h"

namespace anigen::skin_field {

namespace {

using torch::Tensor;

struct Assets {
  std::vector<Tensor> joints, parents, skin;
};

// Skeletons of different size: a lone root, a root that is not joint 0, two roots.
Assets random_assets(torch::Dtype dtype = torch::kFloat32) {
  torch::manual_seed(11);
  const std::vector<std::vector<std::int64_t>> parents = {{-1}, {1, 2, -1, 2, 3}, {-1, 0, -1, 2, 2, 4, 5}};
  const std::vector<std::int64_t> points = {3, 9, 6};
  Assets assets;
  for (std::size_t i = 0; i < parents.size(); ++i) {
    const auto count = static_cast<std::int64_t>(parents[i].size());
    assets.joints.push_back(torch::rand({count, 3}, dtype) - 0.5);
    assets.parents.push_back(torch::tensor(parents[i]));
    assets.skin.push_back(torch::softmax(3.0 * torch::randn({points[i], count}, dtype), 1));
  }
  return assets;
}

SkinAutoEncoderOptions small_options() {
  return SkinAutoEncoderOptions::from_json(Json::parse(R"({
    "encoder_config": {"skin_feat_channels": 4, "skl_pos_embed_freq": 4, "jp_embed_dim": 12,
                       "jp_embedder_config": {"hidden_dim": 16, "depth": 2}},
    "decoder_config": {"skin_feat_channels": 4, "model_channels": 8, "num_blocks": 2, "num_heads": 2}})"));
}

// Options of every documented variant.
std::vector<SkinAutoEncoderOptions> variants() {
  std::vector<SkinAutoEncoderOptions> all(6, small_options());
  all[1].encoder_config.jp_embedder_config.jp_embed_attn = false;
  all[2].encoder_config.relative_pe = false;
  all[3].encoder_config.vert_feat_is_linear = false;
  all[4].encoder_config.normalize_feat = false;
  all[5].decoder_config.vert_cross_blocks_num = 1;
  return all;
}

SkinAutoEncoder make_model(const SkinAutoEncoderOptions& options, torch::Dtype dtype) {
  torch::manual_seed(2);
  SkinAutoEncoder model(options);
  const torch::NoGradGuard no_grad;
  model->to(dtype);
  for (Tensor& parameter : model->parameters()) parameter.add_(0.1 * torch::randn_like(parameter));
  return model;
}

double difference(const Tensor& a, const Tensor& b) { return (a - b).abs().max().item<double>(); }

TEST(SkinAutoEncoder, BatchEqualsOneAssetAtATime) {
  const Assets assets = random_assets();
  for (const SkinAutoEncoderOptions& options : variants()) {
    SkinAutoEncoder model = make_model(options, torch::kFloat32);
    const auto batch = model->forward(assets.joints, assets.parents, assets.skin);
    for (std::size_t i = 0; i < assets.joints.size(); ++i) {
      const auto alone = model->forward({assets.joints[i]}, {assets.parents[i]}, {assets.skin[i]});
      // fp32 rounding of sums of a few hundred terms of size one
      EXPECT_LT(difference(batch.joint_embeds[i], alone.joint_embeds[0]), 5e-6);
      EXPECT_LT(difference(batch.vert_embeds[i], alone.vert_embeds[0]), 5e-6);
      EXPECT_LT(difference(batch.skin[i], alone.skin[0]), 5e-6);
    }
  }
}

TEST(SkinAutoEncoder, WeightsAreDistributionsOverTheAssetsJoints) {
  const Assets assets = random_assets();
  const auto output = make_model(small_options(), torch::kFloat32)->forward(assets.joints, assets.parents, assets.skin);
  for (std::size_t i = 0; i < assets.skin.size(); ++i) {
    ASSERT_EQ(output.skin[i].sizes(), assets.skin[i].sizes());
    EXPECT_LT(difference(output.skin[i].sum(1), torch::ones({assets.skin[i].size(0)})), 1e-5);
    EXPECT_EQ(output.joint_embeds[i].size(1), 4);
  }
}

TEST(SkinAutoEncoder, LogWeightsAreTheLogarithms) {
  const Assets assets = random_assets();
  SkinAutoEncoder model = make_model(small_options(), torch::kFloat32);
  const auto output = model->forward(assets.joints, assets.parents, assets.skin);
  const auto logs = model->reconstruct_log(SkeletonBatch::from_lists(assets.joints, assets.parents), assets.skin);
  for (std::size_t i = 0; i < logs.size(); ++i) EXPECT_LT(difference(logs[i].exp(), output.skin[i]), 1e-6);
}

TEST(SkinAutoEncoder, GradientMatchesFiniteDifferences) {
  const Assets assets = random_assets(torch::kFloat64);
  for (const SkinAutoEncoderOptions& options : variants()) {
    SkinAutoEncoder model = make_model(options, torch::kFloat64);
    const auto loss = [&] {
      const auto output = model->forward(assets.joints, assets.parents, assets.skin);
      Tensor sum = torch::zeros({}, torch::kFloat64);
      for (std::size_t i = 0; i < output.skin.size(); ++i) {
        sum =
            sum + (output.skin[i].square().sum() + output.joint_embeds[i].sum() + output.vert_embeds[i].square().sum());
      }
      return sum;
    };
    loss().backward();
    const torch::NoGradGuard no_grad;
    const double h = 1e-5;
    double slope = 0.0, predicted = 0.0;
    std::vector<Tensor> steps;
    for (const Tensor& parameter : model->parameters()) {
      steps.push_back(torch::randn_like(parameter));
      predicted += (parameter.grad() * steps.back()).sum().item<double>();
    }
    const auto move = [&](double factor) {
      std::vector<Tensor> parameters = model->parameters();
      for (std::size_t p = 0; p < steps.size(); ++p) parameters[p].add_(steps[p], factor);
    };
    move(h);
    slope = loss().item<double>();
    move(-2 * h);
    slope = (slope - loss().item<double>()) / (2 * h);
    // The central difference is exact to h² times the third derivative along a direction of length ~60.
    EXPECT_NEAR(predicted, slope, 1e-4 * (1.0 + std::abs(slope)));
  }
}

TEST(SkinAutoEncoder, RootOffsetIsRelativeToJointZero) {
  // Moving a whole skeleton leaves the features alone with relative positions, but not without.
  const Assets assets = random_assets();
  std::vector<Tensor> moved;
  for (const Tensor& joints : assets.joints) moved.push_back(joints + 0.125);
  for (const bool relative : {true, false}) {
    SkinAutoEncoderOptions options = small_options();
    options.encoder_config.relative_pe = relative;
    SkinAutoEncoder model = make_model(options, torch::kFloat32);
    const auto here = model->forward(assets.joints, assets.parents, assets.skin);
    const auto there = model->forward(moved, assets.parents, assets.skin);
    EXPECT_EQ(difference(here.joint_embeds[2], there.joint_embeds[2]) < 1e-4, relative);
  }
}

TEST(SkinAutoEncoder, PublishedInitialValues) {
  SkinAutoEncoder model(small_options());
  for (const nn::StateEntry& entry : nn::state_entries(*model)) {
    const double largest = entry.tensor.abs().max().item<double>();
    const bool linear = entry.key.find("weight") != std::string::npos;
    EXPECT_EQ(largest > 0.0, linear) << entry.key;
  }
}

TEST(SkinAutoEncoder, RefusesBadInput) {
  SkinAutoEncoder model(small_options());
  const Assets good = random_assets();
  const auto run = [&](const Assets& assets) { model->forward(assets.joints, assets.parents, assets.skin); };
  Assets bad = good;
  bad.parents[1] = torch::tensor({1, 2, -1, 2, 5});
  EXPECT_THROW(run(bad), InputError);
  bad = good;
  bad.parents[1] = torch::tensor({1, 2, -2, 2, 3});
  EXPECT_THROW(run(bad), InputError);
  bad = good;
  bad.joints[2] = torch::full({7, 3}, std::nan(""));
  EXPECT_THROW(run(bad), InputError);
  bad = good;
  bad.joints[0] = torch::empty({0, 3});
  bad.parents[0] = torch::empty({0}, torch::kInt64);
  EXPECT_THROW(run(bad), InputError);
  bad = good;
  bad.skin[1] = torch::ones({4, 6});
  EXPECT_THROW(run(bad), InputError);
  bad = good;
  bad.skin.pop_back();
  EXPECT_THROW(run(bad), InputError);
}

TEST(SkinAutoEncoder, HalfPrecisionNeedsAGpu) {
  SkinAutoEncoder model(small_options());
  EXPECT_THROW(model->convert_to_fp16(), NotSupportedError);
}

TEST(SkinAutoEncoderOptions, JsonRoundTripKeepsEverything) {
  SkinAutoEncoderOptions options = small_options();
  options.use_fp16 = true;
  options.encoder_config.jp_embedder_config.jp_embed_attn = false;
  options.encoder_config.jp_embedder_config.mlp_ratio = 2.0;
  options.encoder_config.normalize_feat = false;
  options.decoder_config.vert_cross_blocks_num = 2;
  const Json json = options.to_json();
  EXPECT_EQ(SkinAutoEncoderOptions::from_json(json).to_json(), json);
}

TEST(SkinAutoEncoderOptions, DefaultsAreThoseOfTheClass) {
  const SkinAutoEncoderOptions options = SkinAutoEncoderOptions::from_json(Json::object());
  EXPECT_EQ(options.encoder_config.skin_feat_channels, 8);
  EXPECT_EQ(options.encoder_config.hidden_dim(), 128);
  EXPECT_EQ(options.encoder_config.jp_embedder_config.depth, 4);
  EXPECT_EQ(options.decoder_config.model_channels, 512);
}

std::string message_of(const char* json) {
  try {
    SkinAutoEncoderOptions::from_json(Json::parse(json), "c.json", "/args");
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST(SkinAutoEncoderOptions, ErrorsNameThePlace) {
  EXPECT_EQ(message_of(R"({"encoder_config": {"jp_embedder_config": {"detph": 3}}})"),
            "c.json: /args/encoder_config/jp_embedder_config: unknown key 'detph'; did you mean 'depth'?");
  EXPECT_NE(
      message_of(R"({"decoder_config": {"model_type": "mlp"}})").find("/args/decoder_config/model_type: not supported"),
      std::string::npos);
  EXPECT_NE(message_of(R"({"decoder_config": {"num_heads": 3}})").find("/args/decoder_config/num_heads"),
            std::string::npos);
  EXPECT_NE(message_of(R"({"encoder_config": {"jp_embed_dim": 12}})").find("hidden_dim"), std::string::npos);
  EXPECT_NE(message_of(R"({"encoder_config": {"skin_feat_channels": 4}})").find("skin_feat_channels"),
            std::string::npos);
  EXPECT_NE(message_of(R"({"encoder_config": {"jp_embed_dim": 99999999999}})").find("jp_embed_dim"), std::string::npos);
}

// First four values and the sums, against the published system (docs/reference/autoencoders.md, 6).
void expect_golden(const Tensor& tensor, double sum, double abs_sum, const std::vector<double>& first) {
  const Tensor values = tensor.detach().to(torch::kFloat64).flatten();
  EXPECT_NEAR(values.sum().item<double>(), sum, 5e-6 * abs_sum);
  EXPECT_NEAR(values.abs().sum().item<double>(), abs_sum, 5e-6 * abs_sum);
  for (std::size_t i = 0; i < first.size(); ++i)
    EXPECT_NEAR(values[static_cast<std::int64_t>(i)].item<double>(), first[i], 2e-6);
}

TEST(SkinAutoEncoder, GoldenNumbersAtPublishedSize) {
  const Json json = Json::parse(R"({
    "encoder_config": {"skin_feat_channels": 4, "skl_pos_embed_freq": 12, "jp_embed_dim": 1024,
                       "jp_embedder_config": {"hidden_dim": 1024, "depth": 6, "jp_embed_attn": true}},
    "decoder_config": {"skin_feat_channels": 4, "model_channels": 64, "num_blocks": 4}, "use_fp16": true})");
  SkinAutoEncoder model(SkinAutoEncoderOptions::from_json(json), nn::Init::kNone);
  test::golden_fill(*model);
  const Tensor joints = test::golden_tensor(1000001, {5, 3}, 0.4);
  const Tensor parents = torch::tensor({-1, 0, 0, 1, 3});
  Tensor skin = test::golden_tensor(1000002, {6, 5}, 0.5, 0.5);
  skin = skin / skin.sum(1, true);
  const torch::NoGradGuard no_grad;
  const auto output = model->forward({joints}, {parents}, {skin});
  expect_golden(output.joint_embeds[0], -0.407101, 1.154537, {0.041205, -0.099104, -0.046963, 0.041613});
  expect_golden(output.vert_embeds[0], -0.090194, 1.403634, {-0.113856, 0.057773, 0.051339, -0.010416});
  expect_golden(output.skin[0], 6.0, 6.0, {0.295265, 0.175164, 0.181719, 0.172753});
}

}  // namespace

namespace {

// Standard deviation over joints of the logits (log weights up to a constant per row) a fresh model gives.
double logit_spread(bool unit_gain) {
  SkinAutoEncoderOptions options;
  options.encoder_config.jp_embed_dim = 64;
  options.encoder_config.jp_embedder_config.hidden_dim = 64;
  options.encoder_config.skin_feat_channels = 4;
  options.decoder_config.skin_feat_channels = 4;
  options.decoder_config.model_channels = 32;
  double sum = 0.0;
  constexpr int kModels = 8;
  for (int seed = 0; seed < kModels; ++seed) {
    torch::manual_seed(seed);
    SkinAutoEncoder model(options);
    if (unit_gain) rescale_to_unit_gain(model);
    const torch::NoGradGuard no_grad;
    const torch::Tensor joints = torch::rand({12, 3}) - 0.5;
    torch::Tensor parents = torch::arange(-1, 11);
    const SkeletonBatch skeletons = SkeletonBatch::from_lists({joints}, {parents});
    const torch::Tensor skin = torch::softmax(6.0 * torch::randn({50, 12}), 1);
    sum += model->reconstruct_log(skeletons, {skin}).front().std(1).mean().item<double>();
  }
  return sum / kModels;
}

TEST(UnitGain, LogitsBeginAlive) {
  EXPECT_LT(logit_spread(false), 0.02);  // the published start: all joints alike
  const double spread = logit_spread(true);
  EXPECT_GT(spread, 0.3);
  EXPECT_LT(spread, 6.0);
}

}  // namespace

}  // namespace anigen::skin_field
