#include "anigen/models/structured_latent_flow_options.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/models/joint_count_embedder.h"
#include "anigen/models/structured_latent_flow_flops.h"
#include "tests/models/small_structured_flow.h"

namespace anigen::models {
namespace {

using torch::Tensor;

std::string slat_flow_option_message(const Json& changes) {
  try {
    test::tiny_slat_flow_options(changes);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(StructuredLatentFlowOptions, RoundTripsAndNamesMistakes) {
  const Json json = test::tiny_slat_flow_options({{"num_heads_skl", nullptr}, {"num_head_channels_skl", 8}}).to_json();
  EXPECT_EQ(StructuredLatentFlowOptions::from_json(json).to_json(), json);
  const auto names = [](const Json& changes, const std::string& word) {
    const std::string message = slat_flow_option_message(changes);
    EXPECT_NE(message.find(word), std::string::npos) << changes << ": " << message;
  };
  names({{"use_joint_num_con", true}}, "use_joint_num_cond");
  names({{"num_heads_vert_skin", 5}}, "/models/denoiser/args/model_channels_vert_skin");
  names({{"patch_size", 4}}, "io_block_channels");
  names({{"io_block_channels", {8, 8}}}, "io_block_channels");
  names({{"io_block_channels_vert_skin", nullptr}}, "io_block_channels_vert_skin");
  names({{"io_block_channels_skl", {0}}}, "io_block_channels_skl");
  names({{"num_blocks", 0}}, "num_blocks");
  names({{"predict_x0", true}, {"out_channels_skl", 3}}, "out_channels_skl");
  names({{"pe_mode", "rope"}}, "not supported");
  EXPECT_EQ(slat_flow_option_message({{"predict_x0", true}, {"out_channels", 3}}), "");  // never of the geometry
  EXPECT_THROW(StructuredLatentFlowOptions::from_json(Json::object()), InputError);
}

TEST(JointCountFeatures, GoldenNumbers) {
  // reference flows-and-pipeline.md, A.4: a quarter of the most.
  const Tensor found = joint_count_features(torch::tensor({15}), 60, 6, torch::kFloat32);
  const double root = 0.7071068;
  const Tensor golden = torch::tensor({root, 1.0, 0.0, 0.0, 0.0, 0.0, root, 0.0, -1.0, 1.0, 1.0, 1.0});
  EXPECT_LT((found[0] - golden).abs().max().item<double>(), 1e-5);  // fp32 of arguments up to 25
}

TEST(JointCountFeatures, HalfPrecisionRoundsTheArguments) {
  const Tensor counts = torch::arange(1, 61);
  const Tensor half = joint_count_features(counts, 60, 6, torch::kHalf).to(torch::kFloat64);
  const Tensor exact = joint_count_features(counts, 60, 6, torch::kFloat64);
  const Tensor part = (counts / 60.0).to(torch::kHalf), frequency = torch::tensor({32.0 * M_PI}).to(torch::kHalf);
  const Tensor argument = (part.to(torch::kFloat32) * frequency.to(torch::kFloat32)).to(torch::kHalf);
  const Tensor expected = argument.to(torch::kFloat64).sin();
  EXPECT_LT((half.select(1, 5) - expected).abs().max().item<double>(), 6e-4);  // rounded once more at the end
  EXPECT_GT((half - exact).abs().max().item<double>(), 0.02);
  // bf16 would move arguments by a quarter; its features are exact up to their own rounding instead.
  const Tensor narrow = joint_count_features(counts, 60, 6, torch::kBFloat16).to(torch::kFloat64);
  EXPECT_LT((narrow - exact).abs().max().item<double>(), 4.5e-3);
}

// A cube of 2³ voxels and a lone one.
sparse::SupportPtr nine_voxels() {
  const Tensor cube = torch::ones({2, 2, 2}).nonzero();
  const Tensor rows = torch::cat({cube, torch::tensor({{5, 5, 5}})});
  return sparse::Support::create(torch::cat({torch::zeros({9, 1}, torch::kInt64), rows}, 1));
}

TEST(StructuredLatentFlowFlops, CountsVoxelsAndTheirNeighbours) {
  const VoxelCounts counts = count_voxels(*nine_voxels(), 1);
  EXPECT_EQ(counts.voxels, (std::vector<double>{9, 2}));
  EXPECT_EQ(counts.taps, (std::vector<double>{8 * 8 + 1, 2}));
  EXPECT_EQ(counts.item_voxels, (std::vector<double>{2}));
}

TEST(StructuredLatentFlowFlops, EqualAHandCount) {
  StructuredLatentFlowOptions options = test::tiny_slat_flow_options();
  options.num_blocks = 1;
  options.mlp_ratio = 2.0;
  options.cond_channels = 3;
  options.skin = options.skeleton = options.geometry;
  options.skeleton.io_block_channels.reset();
  options.geometry.model_channels = 8;
  options.skin.model_channels = 4;
  options.skeleton.model_channels = 2;
  options.skin.io_block_channels = {4};
  const VoxelCounts shape = count_voxels(*nine_voxels(), 1), skeleton = count_voxels(*nine_voxels(), 0);
  const FlopCount count = forward_flops(options, shape, skeleton, 5);
  // Multiplications. Of a stream of width c with n tokens that sees m others of width k: qkv, out, cross q, kv, out,
  // mlp twice, modulation, time.
  const auto torso = [](double n, double c, double m, double k) {
    return n * c * 3 * c + n * c * c + n * c * c + m * k * 2 * c + n * c * c + 2 * n * c * 2 * c + c * 6 * c +
           (256 + c) * c;
  };
  // input and output layer; scales and shifts; skips between 8 and 8 twice as wide: 16 → 8 at both resolutions
  const double geometry = 9 * 8 * (8 + 8) + 8 * 2 * (8 + 8 + 8 + 8) + 16 * 8 * (2 + 9) + torso(2, 8, 5, 3);
  const double skin = 9 * 4 * (8 + 8) + 4 * 2 * (4 + 4 + 4 + 4) + 8 * 4 * (2 + 9) + torso(2, 4, 9, 2) + (12 + 4) * 4;
  const double skl = 9 * 2 * (8 + 8) + torso(9, 2, 2, 4) + (12 + 2) * 2;
  EXPECT_EQ(count.linear, 2.0 * (geometry + skin + skl + 2 * 8 * 4));
  const double taps = 65, coarse = 2;
  const auto residual = [&](double c) {
    return taps * 2 * c * c + coarse * 2 * c * c + 2 * taps * (2 * c * c + c * c);
  };
  EXPECT_EQ(count.convolution, 2.0 * (residual(8) + residual(4)));
  EXPECT_EQ(count.attention, 2.0 * 2.0 * (2 * (2 + 5) * 8 + 2 * (2 + 9) * 4 + 9 * (9 + 2) * 2));
}

// Voxels of a 64³ grid whose centres are this far from the middle, in voxels.
sparse::SupportPtr voxels_between(double from, double to) {
  const Tensor places = torch::ones({1, 64, 64, 64}).nonzero();
  const Tensor distance = (places.slice(1, 1).to(torch::kFloat64) - 31.5).square().sum(1).sqrt();
  const Tensor inside = ((distance >= from) & (distance < to)).nonzero().squeeze(1);
  return sparse::Support::create(places.index_select(0, inside));
}

TEST(StructuredLatentFlowFlops, PublishedModelTakesNineTeraflopForALargeAsset) {
  StructuredLatentFlowOptions options = test::tiny_slat_flow_options();
  options.geometry.model_channels = options.cond_channels = 1024;
  options.skin.model_channels = options.skeleton.model_channels = 512;
  options.geometry.io_block_channels = {128};
  options.skin.io_block_channels = options.skeleton.io_block_channels = {64};
  options.num_blocks = 24;
  const VoxelCounts shape = count_voxels(*voxels_between(28.0, 30.0), 1);
  const VoxelCounts skeleton = count_voxels(*voxels_between(0.0, 9.5), 1);
  EXPECT_EQ(shape.voxels, (std::vector<double>{21008, 4664}));
  const FlopCount count = forward_flops(options, shape, skeleton, 1374);
  EXPECT_NEAR(count.total(), 9.3e12, 0.1e12);
  EXPECT_NEAR(count.convolution, 0.585e12, 0.01e12);
}

}  // namespace
}  // namespace anigen::models
