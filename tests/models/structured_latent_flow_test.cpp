#include "anigen/models/structured_latent_flow.h"

#include <gtest/gtest.h>

#include <set>

#include "anigen/core/error.h"
#include "anigen/models/freezing.h"
#include "anigen/models/state_dict.h"
#include "tests/models/golden_statistics.h"
#include "tests/models/small_structured_flow.h"
#include "tests/models/small_structured_latents.h"
#include "tests/models/torso_dtype.h"

namespace anigen::models {
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
    const std::vector<StateEntry> entries = state_entries(*model);
    for (const StateEntry& entry : entries) {
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
  for (const StateEntry& entry : state_entries(*model)) {
    EXPECT_TRUE(entry.tensor.isfinite().all().item<bool>()) << entry.key;
  }
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
    for (Tensor SlatFlowInputs::*member : {&SlatFlowInputs::t, &SlatFlowInputs::cond, &SlatFlowInputs::joints_num}) {
      one.*member = (one.*member).narrow(0, item, 1);
    }
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
  for (const auto& item : model->named_parameters()) {
    EXPECT_EQ(item.value().requires_grad(), !is_geometry(item.key())) << item.key();
  }
  StructuredLatentFlow unfrozen(
      tiny_slat_flow_options({{"freeze_pretrain_branch", true}, {"use_pretrain_branch", false}}), nn::Init::kNone);
  EXPECT_TRUE(frozen_parameters(*unfrozen).empty());
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

}  // namespace
}  // namespace anigen::models
