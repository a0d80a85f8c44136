#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/nn/state_dict.h"
#include "anigen/nn/trainable.h"
#include "anigen/sparse_structure/autoencoder.h"
#include "tests/vision/deterministic_fill.h"

namespace anigen::sparse_structure {
namespace {

using torch::Tensor;

SparseStructureEncoderOptions small_coder_encoder() {
  return SparseStructureEncoderOptions::from_json(Json::parse(R"({
    "latent_channels": 3, "latent_channels_skl": 2, "num_res_blocks": 1, "num_res_blocks_middle": 1,
    "channels": [4, 6], "encode_global_skl": false, "use_pretrain_branch": false})"));
}

SparseStructureDecoderOptions small_coder_decoder() {
  return SparseStructureDecoderOptions::from_json(Json::parse(R"({
    "latent_channels": 3, "latent_channels_skl": 2, "num_res_blocks": 1, "num_res_blocks_middle": 1,
    "channels": [6, 4], "encode_global_skl": false, "use_pretrain_branch": false, "normalize_z_skl": false})"));
}

Tensor random_occupancy(std::int64_t batch, std::int64_t edge, double share) {
  return (torch::rand({batch, 1, edge, edge, edge}) < share).to(torch::kInt64);
}

// Away from the initial values, among which the residual branches are zero.
template <typename Model>
void shake(Model& model) {
  const torch::NoGradGuard no_grad;
  for (Tensor& parameter : model->parameters()) parameter.add_(0.1 * torch::randn_like(parameter));
}

TEST(SparseStructureAutoEncoder, AnyResolutionThatTheLevelsDivide) {
  torch::manual_seed(1);
  SparseStructureEncoder encoder(small_coder_encoder());
  SparseStructureDecoder decoder(small_coder_decoder());
  for (const std::int64_t edge : {4, 8, 10}) {
    const Tensor x = random_occupancy(2, edge, 0.3);
    const auto latents = encoder->forward(x, x);
    const std::vector<std::int64_t> shape = encoder->latent_shape(2, edge, false);
    EXPECT_EQ(latents.z.sizes(), torch::IntArrayRef(shape));
    EXPECT_EQ(latents.z_skl.sizes(), torch::IntArrayRef(encoder->latent_shape(2, edge, true)));
    const auto logits = decoder->forward(latents.z, latents.z_skl);
    EXPECT_EQ(logits.shape.sizes(), x.sizes());
    EXPECT_EQ(logits.skeleton.sizes(), x.sizes());
  }
  EXPECT_THROW(encoder->forward(random_occupancy(1, 5, 0.3), random_occupancy(1, 5, 0.3)), InputError);
  EXPECT_THROW(encoder->encode_shape(torch::zeros({1, 2, 4, 4, 4})), InputError);
  EXPECT_THROW(decoder->decode_shape(torch::zeros({1, 2, 4, 4, 4})), InputError);
  EXPECT_THROW(decoder->decode_shape(torch::zeros({1, 4, 3})), InputError);
}

TEST(SparseStructureAutoEncoder, LatentsOfTheTwoKinds) {
  torch::manual_seed(2);
  SparseStructureEncoderOptions options = small_coder_encoder();
  options.normalize_scale = 1.5;
  SparseStructureEncoder encoder(options);
  shake(encoder);
  const Tensor x = random_occupancy(2, 8, 0.3);
  const auto still = encoder->forward(x, x);
  EXPECT_TRUE(torch::equal(still.z, still.mean));
  EXPECT_GT(still.logvar.abs().max().item<double>(), 0.0);
  // The skeleton's lies on a sphere and does not vary.
  EXPECT_TRUE(torch::allclose(still.z_skl.norm(2, 1), torch::full({2, 4, 4, 4}, 1.5)));
  EXPECT_FALSE(still.mean_skl.requires_grad());
  EXPECT_EQ(still.logvar_skl.abs().max().item<double>(), 0.0);

  const PosteriorNoise noise{torch::randn(still.z.sizes()), {}};
  const auto drawn = encoder->forward(x, x, &noise);
  EXPECT_TRUE(torch::allclose(drawn.z, still.mean + torch::exp(0.5 * still.logvar) * noise.z));
  EXPECT_TRUE(torch::equal(drawn.z_skl, still.z_skl));
  const PosteriorNoise nothing{}, wrong{torch::randn({2, 3, 4, 4, 5}), {}};
  EXPECT_THROW(encoder->forward(x, x, &nothing), InputError);
  EXPECT_THROW(encoder->forward(x, x, &wrong), InputError);
}

TEST(SparseStructureAutoEncoder, GradientMatchesFiniteDifferences) {
  torch::manual_seed(3);
  SparseStructureEncoder encoder(small_coder_encoder());
  SparseStructureDecoder decoder(small_coder_decoder());
  std::vector<Tensor> parameters = encoder->parameters();
  for (const Tensor& parameter : decoder->parameters()) parameters.push_back(parameter);
  encoder->to(torch::kFloat64);
  decoder->to(torch::kFloat64);
  shake(encoder);
  shake(decoder);
  const Tensor x = random_occupancy(1, 4, 0.4), x_skl = random_occupancy(1, 4, 0.2);
  const PosteriorNoise noise{torch::randn({1, 3, 2, 2, 2}, torch::kFloat64), {}};
  const auto loss = [&] {
    const auto latents = encoder->forward(x, x_skl, &noise);
    const auto logits = decoder->forward(latents.z, latents.z_skl);
    return logits.shape.square().sum() + logits.skeleton.square().sum() + latents.logvar.square().sum();
  };
  loss().backward();
  const torch::NoGradGuard no_grad;
  const double h = 1e-5;
  double predicted = 0.0;
  std::vector<Tensor> steps;
  for (const Tensor& parameter : parameters) {
    steps.push_back(torch::randn_like(parameter) / 8.0);
    predicted += (parameter.grad() * steps.back()).sum().item<double>();
  }
  const auto move = [&](double factor) {
    for (std::size_t p = 0; p < steps.size(); ++p) parameters[p].add_(steps[p], factor);
  };
  move(h);
  double slope = loss().item<double>();
  move(-2 * h);
  slope = (slope - loss().item<double>()) / (2 * h);
  // The central difference is exact to h² times the third derivative along a direction of length ~10.
  EXPECT_NEAR(predicted, slope, 1e-5 * (1.0 + std::abs(slope)));
}

TEST(SparseStructureAutoEncoder, FreshBlocksAreTheIdentity) {
  torch::manual_seed(4);
  VolumeResBlock block(5, 5);
  initialize_volume_layers(*block);
  const Tensor x = torch::randn({1, 5, 3, 3, 3});
  EXPECT_TRUE(torch::equal(block->forward(x), x));
  VolumeResBlock wider(5, 7);
  initialize_volume_layers(*wider);
  EXPECT_EQ(wider->forward(x).size(1), 7);
  EXPECT_GT(wider->forward(x).abs().max().item<double>(), 0.0);
}

TEST(SparseStructureAutoEncoder, LatentsOnTheSphereOfEitherNorm) {
  SparseStructureEncoderOptions options = small_coder_encoder();
  options.latent_denoising = options.normalize_z = true;
  options.normalize_scale = 2.0;
  const Tensor x = random_occupancy(1, 8, 0.3);
  const auto latents = [&](const char* norm) {
    options.normalize_norm = norm;
    torch::manual_seed(5);
    SparseStructureEncoder encoder(options);
    shake(encoder);
    const torch::NoGradGuard no_grad;
    return encoder->forward(x, x);
  };
  const auto l2 = latents("l2"), l1 = latents("l1");
  for (const auto& [of_l1, of_l2] : {std::pair{l1.z, l2.z}, {l1.z_skl, l2.z_skl}}) {
    EXPECT_TRUE(torch::allclose(of_l1.norm(1, 1), torch::full_like(of_l1.norm(1, 1), 2.0), 1e-5));
    EXPECT_TRUE(torch::allclose(of_l2.norm(2, 1), torch::full_like(of_l2.norm(2, 1), 2.0), 1e-5));
    // Directions are those of the same weights.
    EXPECT_TRUE(torch::allclose(2.0 * unit_latents(of_l1), of_l2, 1e-4, 1e-5));
  }
}

TEST(SparseStructureAutoEncoder, FreezesTheShapeStreamOnly) {
  SparseStructureEncoderOptions options = small_coder_encoder();
  options.use_pretrain_branch = true;
  SparseStructureEncoder encoder(options, nn::Init::kNone);
  for (const nn::StateEntry& entry : nn::state_entries(*encoder)) {
    const bool skeleton = entry.key.substr(0, entry.key.find('.')).find("_skl") != std::string::npos;
    EXPECT_EQ(entry.tensor.requires_grad(), skeleton) << entry.key;
  }
  options.freeze_pretrain_branch = false;
  EXPECT_TRUE(nn::frozen_parameters(*SparseStructureEncoder(options, nn::Init::kNone)).empty());
}

TEST(Freezing, ExactNamesBareParametersAndLowRankAdditions) {
  struct Part : torch::nn::Module {
    Part() {
      register_parameter("weight", torch::zeros({2}));
      register_parameter("lora_A", torch::zeros({2}));
    }
  };
  torch::nn::Module model;
  for (const char* name : {"blocks", "blocks_skl"}) model.register_module(name, std::make_shared<Part>());
  model.register_parameter("token", torch::zeros({2}));
  model.register_parameter("token_skl", torch::zeros({2}));
  nn::freeze_modules(model, {"blocks", "token", "no_such_module"});
  EXPECT_FALSE(model.named_parameters(false)["token"].requires_grad());
  EXPECT_TRUE(model.named_parameters(false)["token_skl"].requires_grad());
  const auto children = model.named_children();
  EXPECT_EQ(nn::frozen_parameters(*children["blocks"]), std::vector<std::string>{"weight"});
  EXPECT_TRUE(nn::frozen_parameters(*children["blocks_skl"]).empty());
}

TEST(SparseStructureAutoEncoder, TokensOfTheGlobalVariant) {
  torch::manual_seed(5);
  // Seven levels: one cell is left of the 64³ grid, so that the test stays small.
  Json json = Json::parse(R"({"latent_channels": 4, "latent_channels_skl": 4, "num_res_blocks": 0,
    "num_res_blocks_middle": 0, "channels": [1, 1, 1, 1, 2, 4, 16], "encode_global": true, "encode_global_skl": true,
    "global_token_num": 5, "global_token_num_skl": 3, "use_pretrain_branch": false})");
  SparseStructureEncoder encoder(SparseStructureEncoderOptions::from_json(json));
  const Tensor x = random_occupancy(2, 64, 0.1);
  const auto latents = encoder->forward(x, x);
  EXPECT_EQ(latents.z.sizes(), torch::IntArrayRef({2, 5, 4}));
  EXPECT_EQ(latents.z_skl.sizes(), torch::IntArrayRef({2, 3, 4}));
  json["channels"] = Json::array({16, 4, 2, 1, 1, 1, 1});
  SparseStructureDecoder decoder(SparseStructureDecoderOptions::from_json(json));
  EXPECT_EQ(decoder->forward(latents.z, latents.z_skl).skeleton.sizes(), x.sizes());
  EXPECT_THROW(decoder->decode_shape(latents.z_skl), InputError);  // three tokens, not five
  EXPECT_THROW(encoder->encode_shape(random_occupancy(1, 128, 0.1)), InputError);
}

TEST(SparseStructureOptions, JsonRoundTripKeepsEverything) {
  Json json = small_coder_encoder().to_json();
  json["norm_type"] = "group";
  json["channels"] = Json::array({8, 64});
  json["use_fp16"] = true;
  json["latent_denoising"] = true;
  json["normalize_scale"] = 2.5;
  json["modules_to_freeze"] = Json::array({"blocks"});
  EXPECT_EQ(SparseStructureEncoderOptions::from_json(json).to_json(), json);
  const Json decoder = small_coder_decoder().to_json();
  EXPECT_EQ(SparseStructureDecoderOptions::from_json(decoder).to_json(), decoder);
}

TEST(SparseStructureOptions, BadValuesNameTheKey) {
  const auto message = [](const char* key, const Json& value) {
    Json json = small_coder_encoder().to_json();
    json[key] = value;
    try {
      SparseStructureEncoderOptions::from_json(json, "config.json", "/models/encoder/args");
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  EXPECT_NE(message("chanels", 3).find("channels"), std::string::npos);
  EXPECT_NE(message("channels", Json::array()).find("channels"), std::string::npos);
  EXPECT_NE(message("channels", Json::array({4, -1})).find("channels"), std::string::npos);
  EXPECT_NE(message("norm_type", "batch").find("norm_type"), std::string::npos);
  EXPECT_NE(message("norm_type", "group").find("32"), std::string::npos);  // 6 channels
  EXPECT_NE(message("encode_global", true).find("16"), std::string::npos);
  Json without = small_coder_encoder().to_json();
  without.erase("channels");
  EXPECT_THROW(SparseStructureEncoderOptions::from_json(without), InputError);
}

TEST(SparseStructureAutoEncoder, HalfPrecisionNeedsAGpu) {
  SparseStructureEncoder encoder(small_coder_encoder());
  EXPECT_THROW(encoder->convert_to_fp16(), NotSupportedError);
  EXPECT_TRUE(encoder->half_precision_modules().empty());
}

// Means over many numbers agree to a millionth of the sum of magnitudes, single numbers to fp32 rounding of deep sums.
void expect_golden_volume(const Tensor& tensor, double sum, double abs_sum, const std::vector<double>& first) {
  const Tensor values = tensor.detach().to(torch::kFloat64).flatten();
  EXPECT_NEAR(values.sum().item<double>(), sum, 5e-6 * abs_sum);
  EXPECT_NEAR(values.abs().sum().item<double>(), abs_sum, 5e-6 * abs_sum);
  for (std::size_t i = 0; i < first.size(); ++i)
    EXPECT_NEAR(values[static_cast<std::int64_t>(i)].item<double>(), first[i], 1e-5);
}

TEST(SparseStructureAutoEncoder, GoldenNumbersAtPublishedSize) {
  const torch::NoGradGuard no_grad;
  const Tensor x = test::golden_tensor(1000003, {1, 1, 16, 16, 16}) > 0.7;
  const Tensor x_skl = test::golden_tensor(1000004, {1, 1, 16, 16, 16}) > 0.9;
  Json json = Json::parse(R"({"channels": [32, 128, 512], "encode_global_skl": false, "use_fp16": true})");
  SparseStructureEncoderImpl::Output latents;
  {
    SparseStructureEncoder encoder(SparseStructureEncoderOptions::from_json(json), nn::Init::kNone);
    test::golden_fill(*encoder);
    latents = encoder->forward(x, x_skl);
  }
  expect_golden_volume(latents.z, -47.239659, 156.948455, {0.314100, -0.212891, 0.001089, 0.270705});
  expect_golden_volume(latents.logvar, -38.078233, 173.962534, {-0.375123, -0.010350, -0.035686, 0.100712});
  expect_golden_volume(latents.z_skl, -21.607597, 106.990107, {0.347651, 0.347820, -0.193820, -0.576579});
  json["channels"] = Json::array({512, 128, 32});
  json["normalize_z_skl"] = false;
  SparseStructureDecoder decoder(SparseStructureDecoderOptions::from_json(json), nn::Init::kNone);
  test::golden_fill(*decoder);
  const auto logits = decoder->forward(latents.z, latents.z_skl);
  expect_golden_volume(logits.shape, 361.182103, 1765.062528, {0.162992, -0.286708, -0.696443, -0.866775});
  expect_golden_volume(logits.skeleton, -194.335357, 1656.094878, {0.030935, -0.092553, -0.313878, 0.273717});
}

}  // namespace
}  // namespace anigen::sparse_structure
