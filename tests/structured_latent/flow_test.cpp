#include <gtest/gtest.h>
#include <set>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/attention_windows.h"
#include "anigen/nn/embeddings.h"
#include "anigen/nn/state_dict.h"
#include "anigen/nn/trainable.h"
#include "anigen/structured_latent/flow.h"
#include "benchmarks/structured_latent_flow_flops.h"
#include "tests/sparse_structure/golden_statistics.h"
#include "tests/sparse_structure/torso_dtype.h"
#include "tests/structured_latent/small_structured_flow.h"
#include "tests/structured_latent/small_structured_latents.h"

namespace anigen::structured_latent {

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
  // docs/reference/flows.md, 7.2: a quarter of the most.
  const Tensor found = nn::joint_count_features(torch::tensor({15}), 60, 6, torch::kFloat32);
  const double root = 0.7071068;
  const Tensor golden = torch::tensor({root, 1.0, 0.0, 0.0, 0.0, 0.0, root, 0.0, -1.0, 1.0, 1.0, 1.0});
  EXPECT_LT((found[0] - golden).abs().max().item<double>(), 1e-5);  // fp32 of arguments up to 25
}

TEST(JointCountFeatures, HalfPrecisionRoundsTheArguments) {
  const Tensor counts = torch::arange(1, 61);
  const Tensor half = nn::joint_count_features(counts, 60, 6, torch::kHalf).to(torch::kFloat64);
  const Tensor exact = nn::joint_count_features(counts, 60, 6, torch::kFloat64);
  const Tensor part = (counts / 60.0).to(torch::kHalf), frequency = torch::tensor({32.0 * M_PI}).to(torch::kHalf);
  const Tensor argument = (part.to(torch::kFloat32) * frequency.to(torch::kFloat32)).to(torch::kHalf);
  const Tensor expected = argument.to(torch::kFloat64).sin();
  EXPECT_LT((half.select(1, 5) - expected).abs().max().item<double>(), 6e-4);  // rounded once more at the end
  EXPECT_GT((half - exact).abs().max().item<double>(), 0.02);
  // bf16 would move arguments by a quarter; its features are exact up to their own rounding instead.
  const Tensor narrow = nn::joint_count_features(counts, 60, 6, torch::kBFloat16).to(torch::kFloat64);
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
  const nn::FlopCount count = forward_flops(options, shape, skeleton, 5);
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
  const nn::FlopCount count = forward_flops(options, shape, skeleton, 1374);
  EXPECT_NEAR(count.total(), 9.3e12, 0.1e12);
  EXPECT_NEAR(count.convolution, 0.585e12, 0.01e12);
}

}  // namespace

namespace {

using test::filled_slat_flow;
using test::run_slat_flow;
using test::SlatFlowInputs;
using test::tiny_slat_flow_options;
using torch::Tensor;

double feats_difference(const Tensor& a, const Tensor& b) { return (a - b).abs().max().item<double>(); }

Tensor geometry_of(const StructuredVelocity& velocity) { return velocity.x.feats.narrow(1, 0, 8); }
Tensor skin_of(const StructuredVelocity& velocity) { return velocity.x.feats.narrow(1, 8, 8); }

StructuredLatentFlowOptions published_slat_flow_options(bool joints) {
  StructuredLatentFlowOptions options = tiny_slat_flow_options({{"use_joint_num_cond", joints}});
  options.geometry.model_channels = options.cond_channels = 1024;
  options.skin.model_channels = options.skeleton.model_channels = 512;
  options.num_blocks = 24;
  options.geometry.num_heads = options.skin.num_heads = options.skeleton.num_heads = 16;
  options.geometry.io_block_channels = {128};
  options.skin.io_block_channels = options.skeleton.io_block_channels = {64};
  options.use_fp16 = options.freeze_pretrain_branch = true;
  return options;
}

TEST(StructuredLatentFlow, GoldenNumbersWithJointCounts) {
  const StructuredVelocity velocity = run_slat_flow(filled_slat_flow(tiny_slat_flow_options()));
  test::expect_statistics(velocity.x.feats, {-0.05517357, -0.0006246753, 0.001466495, 0.05557723, 0.05777499,
                                             0.04368322, 75.83647, 12.87536});
  test::expect_statistics(velocity.x_skl.feats, {-0.05061911, -0.0228819, -0.06215056, -0.06087337, -0.06385624,
                                                 -0.04467741, -10.83762, 0.5746893});
}

TEST(StructuredLatentFlow, GoldenNumbersWithoutJointCounts) {
  SlatFlowInputs inputs;
  inputs.joints_num = Tensor();
  const StructuredVelocity velocity =
      run_slat_flow(filled_slat_flow(tiny_slat_flow_options({{"use_joint_num_cond", false}})), inputs);
  test::expect_statistics(velocity.x.feats, {-0.05517357, -0.0006246753, 0.001466495, 0.05557723, 0.05728728,
                                             0.04351488, 75.85332, 12.90762});
  test::expect_statistics(velocity.x_skl.feats, {-0.05002352, -0.01864738, -0.06197824, -0.06507663, -0.06396935,
                                                 -0.04297843, -10.8264, 0.577465});
}

TEST(StructuredLatentFlow, PublishedSizesHaveThePublishedKeys) {
  for (const bool joints : {false, true}) {
    // Reserves memory, touches none.
    StructuredLatentFlow model(published_slat_flow_options(joints), nn::Init::kNone);
    std::int64_t parameters = 0, trainable = 0;
    const std::vector<nn::StateEntry> entries = nn::state_entries(*model);
    for (const nn::StateEntry& entry : entries) {
      parameters += entry.tensor.numel();
      trainable += entry.tensor.requires_grad() ? entry.tensor.numel() : 0;
    }
    EXPECT_EQ(entries.size(), joints ? 1780U : 1770U);
    EXPECT_EQ(parameters, 913763604 + (joints ? 539648 : 0));
    EXPECT_EQ(trainable, 313281932 + (joints ? 539648 : 0));
  }
}

TEST(StructuredLatentFlow, FreshModelAnswersZero) {
  torch::manual_seed(3);
  StructuredLatentFlow model(tiny_slat_flow_options());
  const StructuredVelocity velocity = run_slat_flow(model);
  EXPECT_EQ(velocity.x.feats.abs().max().item<double>(), 0.0);
  EXPECT_EQ(velocity.x_skl.feats.abs().max().item<double>(), 0.0);
  for (const nn::StateEntry& entry : nn::state_entries(*model))
    EXPECT_TRUE(entry.tensor.isfinite().all().item<bool>()) << entry.key;
}

TEST(StructuredLatentFlow, GeometryHearsOfNothingButTheImage) {
  StructuredLatentFlow model = filled_slat_flow(tiny_slat_flow_options());
  const SlatFlowInputs inputs;
  const StructuredVelocity base = run_slat_flow(model);
  std::vector<SlatFlowInputs> others(3);
  others[0].x.feats = torch::cat({inputs.x.feats.narrow(1, 0, 8), -inputs.x.feats.narrow(1, 8, 8)}, 1);
  others[1].x_skl.feats = -inputs.x_skl.feats;
  others[2].joints_num = torch::tensor({5, 50});
  for (const SlatFlowInputs& other : others) {
    const StructuredVelocity velocity = run_slat_flow(model, other);
    EXPECT_TRUE(torch::equal(geometry_of(velocity), geometry_of(base)));
    EXPECT_GT(feats_difference(skin_of(velocity), skin_of(base)), 0.0);
    EXPECT_GT(feats_difference(velocity.x_skl.feats, base.x_skl.feats), 0.0);
  }
  SlatFlowInputs other_image;
  other_image.cond = -other_image.cond;
  EXPECT_GT(feats_difference(geometry_of(run_slat_flow(model, other_image)), geometry_of(base)), 0.0);
  // Without adapters the skin does not hear of the image either.
  const torch::NoGradGuard no_grad;
  for (auto& item : model->named_parameters()) {
    if (item.key().find("adapter_geo_to_skin") == 0) item.value().zero_();
  }
  EXPECT_TRUE(torch::equal(skin_of(run_slat_flow(model)), skin_of(run_slat_flow(model, other_image))));
}

TEST(StructuredLatentFlow, AttendsInsideWindowsWhileTheyLive) {
  const StructuredLatentFlow model = filled_slat_flow(tiny_slat_flow_options());
  const StructuredVelocity full = run_slat_flow(model);
  const auto differences = [&](std::int64_t window) {
    const nn::AttentionWindows windows(window);
    const StructuredVelocity found = run_slat_flow(model);
    return std::vector<double>{feats_difference(geometry_of(found), geometry_of(full)),
                               feats_difference(skin_of(found), skin_of(full)),
                               feats_difference(found.x_skl.feats, full.x_skl.feats)};
  };
  for (const double difference : differences(128)) EXPECT_LT(difference, 1e-5);  // one window holds all voxels
  for (const double difference : differences(2)) EXPECT_GT(difference, 1e-5);
  EXPECT_TRUE(torch::equal(run_slat_flow(model).x.feats, full.x.feats));
}

TEST(StructuredLatentFlow, ItemAloneEqualsItemInABatch) {
  StructuredLatentFlow model = filled_slat_flow(tiny_slat_flow_options());
  const SlatFlowInputs inputs;
  const StructuredVelocity both = run_slat_flow(model);
  for (std::int64_t item = 0; item < 2; ++item) {
    const auto alone = [&](const sparse::SparseTensor& x) {
      const std::int64_t first = x.support->items().offset(item);
      const std::int64_t count = x.support->items().lengths()[static_cast<std::size_t>(item)];
      Tensor coords = x.support->coords().narrow(0, first, count).clone();
      coords.select(1, 0).zero_();
      return sparse::SparseTensor{sparse::Support::create(coords), x.feats.narrow(0, first, count)};
    };
    SlatFlowInputs one;
    one.x = alone(inputs.x);
    one.x_skl = alone(inputs.x_skl);
    for (Tensor SlatFlowInputs::*member : {&SlatFlowInputs::t, &SlatFlowInputs::cond, &SlatFlowInputs::joints_num})
      one.*member = (one.*member).narrow(0, item, 1);
    const StructuredVelocity velocity = run_slat_flow(model, one);
    // Sums of at most a few hundred fp32 values of size one, in another order.
    EXPECT_LT(feats_difference(velocity.x.feats, alone(both.x).feats), 1e-5);
    EXPECT_LT(feats_difference(velocity.x_skl.feats, alone(both.x_skl).feats), 1e-5);
  }
}

TEST(StructuredLatentFlow, OrderOfVoxelsDoesNotMatter) {
  StructuredLatentFlow model = filled_slat_flow(tiny_slat_flow_options());
  const SlatFlowInputs inputs;
  const Tensor order = torch::cat({torch::arange(54, -1, -1), torch::arange(98, 54, -1)});
  SlatFlowInputs turned;
  turned.x = {sparse::Support::create(inputs.x.support->coords().index_select(0, order)),
              inputs.x.feats.index_select(0, order)};
  const StructuredVelocity base = run_slat_flow(model), other = run_slat_flow(model, turned);
  EXPECT_LT(feats_difference(other.x.feats, base.x.feats.index_select(0, order)), 1e-5);
  EXPECT_LT(feats_difference(other.x_skl.feats, base.x_skl.feats), 1e-5);
}

TEST(StructuredLatentFlow, NoWishIsNoCount) {
  StructuredLatentFlow model = filled_slat_flow(tiny_slat_flow_options());
  const auto skeleton_for = [&](const Tensor& joints_num) {
    SlatFlowInputs inputs;
    inputs.joints_num = joints_num;
    return run_slat_flow(model, inputs).x_skl.feats;
  };
  const Tensor none = skeleton_for({});
  EXPECT_TRUE(torch::equal(skeleton_for(torch::tensor({0})), none));
  EXPECT_TRUE(torch::equal(skeleton_for(torch::tensor({-1, 0})), none));
  EXPECT_TRUE(torch::equal(skeleton_for(torch::tensor({60})), skeleton_for(torch::tensor({75, 60}))));
  EXPECT_TRUE(torch::equal(skeleton_for(torch::tensor({25})), skeleton_for(torch::tensor({25.0F, 25.0F}))));
  EXPECT_GT(feats_difference(skeleton_for(torch::tensor({25})), none), 0.0);
  EXPECT_GT(feats_difference(skeleton_for(torch::tensor({25})), skeleton_for(torch::tensor({26}))), 0.0);
}

TEST(StructuredLatentFlow, EveryVariantKeepsTheShapeOfItsInputs) {
  const std::vector<Json> variants = {
      {{"share_mod", true}},
      {{"use_skip_connection", false}, {"num_io_res_blocks_skl", 3}, {"num_io_res_blocks", 1}},
      {{"patch_size", 1},
       {"io_block_channels", nullptr},
       {"io_block_channels_vert_skin", nullptr},
       {"io_block_channels_skl", nullptr}},
      {{"io_block_channels_skl", nullptr}},  // a skeleton transformer at full resolution
      {{"patch_size", 4},
       {"io_block_channels", {8, 12}},
       {"io_block_channels_vert_skin", {6, 10}},
       {"io_block_channels_skl", {4, 8}}},
      {{"predict_x0", true}},
      {{"qk_rms_norm_cross", true}},
      {{"qk_rms_norm", false}}};
  std::set<double> sums;
  for (const Json& changes : variants) {
    StructuredLatentFlow model = filled_slat_flow(tiny_slat_flow_options(changes));
    const SlatFlowInputs inputs;
    const StructuredVelocity velocity = run_slat_flow(model);
    EXPECT_EQ(velocity.x.feats.sizes(), inputs.x.feats.sizes()) << changes;
    EXPECT_EQ(velocity.x_skl.feats.sizes(), inputs.x_skl.feats.sizes()) << changes;
    EXPECT_TRUE(velocity.x.feats.isfinite().all().item<bool>()) << changes;
    sums.insert(velocity.x_skl.feats.square().sum().item<double>());
  }
  EXPECT_EQ(sums.size(), variants.size());  // every option changes something
}

TEST(StructuredLatentFlow, AnItemMayHaveNoSkeletonVoxels) {
  StructuredLatentFlow model = filled_slat_flow(tiny_slat_flow_options());
  SlatFlowInputs inputs;
  const std::int64_t first = inputs.x_skl.support->items().lengths()[0];
  inputs.x_skl = {sparse::Support::create(inputs.x_skl.support->coords().narrow(0, 0, first), 2),
                  inputs.x_skl.feats.narrow(0, 0, first)};
  const StructuredVelocity velocity = run_slat_flow(model, inputs), base = run_slat_flow(model);
  EXPECT_TRUE(velocity.x.feats.isfinite().all().item<bool>());
  EXPECT_LT(feats_difference(velocity.x_skl.feats, base.x_skl.feats.narrow(0, 0, first)), 1e-5);
}

TEST(StructuredLatentFlow, OneConditionServesAllItems) {
  StructuredLatentFlow model = filled_slat_flow(tiny_slat_flow_options());
  SlatFlowInputs one, repeated;
  one.cond = one.cond.narrow(0, 0, 1);
  repeated.cond = one.cond.repeat({2, 1, 1});
  EXPECT_LT(feats_difference(run_slat_flow(model, one).x.feats, run_slat_flow(model, repeated).x.feats), 1e-6);
}

TEST(StructuredLatentFlow, GradientsAgreeWithDifferences) {
  torch::manual_seed(11);
  for (const Json& changes : {Json::object(), Json{{"share_mod", true}, {"use_skip_connection", false}},
                              Json{{"predict_x0", true}, {"use_checkpoint", true}}}) {
    StructuredLatentFlow model = filled_slat_flow(tiny_slat_flow_options(changes));
    model->to(torch::kFloat64);
    test::stir(*model, 0.05);
    SlatFlowInputs inputs;
    inputs.x.feats = inputs.x.feats.to(torch::kFloat64).requires_grad_();
    inputs.x_skl.feats = inputs.x_skl.feats.to(torch::kFloat64).requires_grad_();
    inputs.cond = inputs.cond.to(torch::kFloat64).requires_grad_();
    std::vector<Tensor> moved = model->parameters();
    moved.insert(moved.end(), {inputs.x.feats, inputs.x_skl.feats, inputs.cond});
    test::expect_gradient_of(
        moved,
        [&] {
          const auto velocity = model->forward(inputs.x, inputs.x_skl, inputs.t, inputs.cond, inputs.joints_num);
          return velocity.x.feats.square().sum() + velocity.x_skl.feats.square().sum();
        },
        1e-6);
  }
}

TEST(StructuredLatentFlow, CheckpointingChangesMemoryAndNotGradients) {
  const SlatFlowInputs inputs;
  for (const bool frozen : {false, true}) {
    std::vector<Tensor> gradients;
    for (const bool checkpointing : {false, true}) {
      StructuredLatentFlow model = filled_slat_flow(
          tiny_slat_flow_options({{"use_checkpoint", checkpointing}, {"freeze_pretrain_branch", frozen}}));
      const auto velocity = model->forward(inputs.x, inputs.x_skl, inputs.t, inputs.cond, inputs.joints_num);
      (velocity.x.feats.square().sum() + velocity.x_skl.feats.square().sum()).backward();
      std::vector<Tensor> list;
      for (const auto& item : model->named_parameters()) {
        if (!item.value().requires_grad()) continue;
        EXPECT_TRUE(item.value().grad().defined()) << item.key();
        list.push_back(item.value().grad().flatten());
      }
      gradients.push_back(torch::cat(list));
    }
    const double size = gradients[0].abs().max().item<double>();
    EXPECT_GT(size, 0.0);
    EXPECT_LT(feats_difference(gradients[0], gradients[1]), 1e-5 * size);
  }
}

TEST(StructuredLatentFlow, FreezesTheGeometry) {
  const auto is_geometry = [](const std::string& key) {
    return key.find("_vert_skin") == std::string::npos && key.find("_skl") == std::string::npos &&
           key.find("adapter") == std::string::npos;
  };
  StructuredLatentFlow model(tiny_slat_flow_options({{"freeze_pretrain_branch", true}}), nn::Init::kNone);
  for (const auto& item : model->named_parameters())
    EXPECT_EQ(item.value().requires_grad(), !is_geometry(item.key())) << item.key();
  StructuredLatentFlow unfrozen(
      tiny_slat_flow_options({{"freeze_pretrain_branch", true}, {"use_pretrain_branch", false}}), nn::Init::kNone);
  EXPECT_TRUE(nn::frozen_parameters(*unfrozen).empty());
}

TEST(StructuredLatentFlow, TorsoComputesInBfloat16) {
  StructuredLatentFlow model = filled_slat_flow(tiny_slat_flow_options({{"use_fp16", true}}));
  const StructuredVelocity full = run_slat_flow(model);
  model->set_compute_dtype(torch::kBFloat16);
  test::expect_bfloat16_torso(model);
  EXPECT_EQ(model->named_parameters()["joint_num_uncond_skl"].scalar_type(), torch::kBFloat16);
  EXPECT_EQ(model->named_parameters()["input_blocks.0.norm1.weight"].scalar_type(), torch::kFloat32);
  const StructuredVelocity reduced = run_slat_flow(model);
  EXPECT_EQ(reduced.x.feats.scalar_type(), torch::kFloat32);
  // Eight bits of mantissa, 0.4 % each time, through convolutions, two blocks and the norm at the end.
  EXPECT_GT(feats_difference(full.x.feats, reduced.x.feats), 0.0);
  EXPECT_LT(feats_difference(full.x.feats, reduced.x.feats), 0.1 * full.x.feats.abs().max().item<double>());
  EXPECT_LT(feats_difference(full.x_skl.feats, reduced.x_skl.feats), 0.1 * full.x_skl.feats.abs().max().item<double>());
  EXPECT_THROW(model->set_compute_dtype(torch::kHalf), NotSupportedError);
}

TEST(StructuredLatentFlow, RefusesInputsOfAnotherShape) {
  StructuredLatentFlow model = filled_slat_flow(tiny_slat_flow_options());
  const SlatFlowInputs inputs;
  std::vector<SlatFlowInputs> wrong(8);
  wrong[0].x.feats = torch::zeros({99, 8});
  wrong[1].x.feats = torch::zeros({98, 16});
  wrong[2].x_skl.feats = torch::zeros({55, 5});
  wrong[3].x_skl = {sparse::Support::create(inputs.x_skl.support->coords(), 3), inputs.x_skl.feats};
  wrong[4].t = torch::zeros({3});
  wrong[5].cond = torch::zeros({2, 5, 19});
  wrong[6].cond = torch::zeros({3, 5, 20});
  wrong[7].joints_num = torch::zeros({3});
  for (const SlatFlowInputs& other : wrong) EXPECT_THROW(run_slat_flow(model, other), InputError);
  // A wish that the model cannot hear is a mistake, not a detail.
  EXPECT_THROW(run_slat_flow(filled_slat_flow(tiny_slat_flow_options({{"use_joint_num_cond", false}}))), InputError);
}

// Nothing flows into the geometry, so that it is the same without the others.
TEST(StructuredLatentFlow, GeometryAloneIsTheGeometryOfAllStreams) {
  const Json without_counts = {{"use_joint_num_cond", false}};
  StructuredLatentFlow all = test::filled_slat_flow(test::tiny_slat_flow_options(without_counts));
  Json changes = without_counts;
  changes["geometry_only"] = true;
  const StructuredLatentFlowOptions options = test::tiny_slat_flow_options(changes);
  EXPECT_EQ(StructuredLatentFlowOptions::from_json(options.to_json()).to_json(), options.to_json());
  EXPECT_FALSE(test::tiny_slat_flow_options().to_json().contains("geometry_only"));
  EXPECT_NE(slat_flow_option_message({{"geometry_only", true}, {"use_joint_num_cond", true}}).find("geometry_only"),
            std::string::npos);
  StructuredLatentFlow alone(options, nn::Init::kPublished);
  const auto weights = all->named_parameters();
  const torch::NoGradGuard no_grad;
  for (auto& parameter : alone->named_parameters()) {
    EXPECT_EQ(parameter.key().find("_sk"), std::string::npos) << parameter.key();
    parameter.value().copy_(weights[parameter.key()]);
  }
  test::SlatFlowInputs inputs;
  inputs.joints_num = Tensor();
  const StructuredVelocity both = test::run_slat_flow(all, inputs), one = test::run_slat_flow(alone, inputs);
  const std::int64_t geometry = options.geometry.out_channels;
  EXPECT_TRUE(torch::equal(one.x.feats.slice(1, 0, geometry), both.x.feats.slice(1, 0, geometry)));
  EXPECT_EQ(one.x.feats.sizes(), both.x.feats.sizes());
  EXPECT_EQ(one.x.feats.slice(1, geometry).abs().max().item<double>(), 0.0);
  EXPECT_EQ(one.x_skl.feats.abs().max().item<double>(), 0.0);
}

}  // namespace

}  // namespace anigen::structured_latent
