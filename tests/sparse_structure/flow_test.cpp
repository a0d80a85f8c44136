#include "anigen/sparse_structure/flow.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/attention_windows.h"
#include "anigen/nn/kernels/tiles.h"
#include "anigen/nn/state_dict.h"
#include "benchmarks/sparse_structure_flow_flops.h"
#include "tests/sparse_structure/golden_statistics.h"
#include "tests/sparse_structure/torso_dtype.h"
#include "tests/sparse_structure/wave_fill.h"
#include "tests/support/kernel_forms.h"
#include "tests/support/paths.h"

namespace anigen::sparse_structure {
namespace {

using torch::Tensor;

// The tiny model of docs/reference/flows.md, 7.2.
SparseStructureFlowOptions tiny_flow_options() {
  return SparseStructureFlowOptions::from_json(Json::parse(R"({
    "resolution": 4, "in_channels": 8, "in_channels_skl": 4, "out_channels": 8, "out_channels_skl": 4,
    "model_channels": 32, "model_channels_skl": 24, "cond_channels": 20, "num_blocks": 3, "num_heads": 2,
    "mlp_ratio": 4, "patch_size": 1, "pe_mode": "ape", "qk_rms_norm": true, "freeze_pretrain_branch": false})"));
}

SparseStructureFlowOptions published_flow_options(bool lora) {
  SparseStructureFlowOptions options = tiny_flow_options();
  options.resolution = 16;
  options.model_channels = options.model_channels_skl = options.cond_channels = 1024;
  options.num_blocks = 24;
  options.num_heads = 16;
  options.use_fp16 = true;
  options.use_lora_ss = lora;
  return options;
}

SparseStructureFlow filled_flow(const SparseStructureFlowOptions& options) {
  SparseStructureFlow model(options, nn::Init::kNone);
  test::wave_fill(*model);
  return model;
}

struct FlowInputs {
  Tensor x = test::wave({2, 8, 4, 4, 4}, 0.11, 0.0), x_skl = test::wave({2, 4, 4, 4, 4}, 0.17, 0.3);
  Tensor t = torch::tensor({500.0f, 250.0f}), cond = test::wave({2, 5, 20}, 0.23, 0.7);
};

Velocity run_flow(SparseStructureFlow model, const FlowInputs& inputs = {}) {
  const torch::NoGradGuard no_grad;
  return model->forward(inputs.x, inputs.x_skl, inputs.t, inputs.cond);
}

double flow_difference(const Tensor& a, const Tensor& b) { return (a - b).abs().max().item<double>(); }

TEST(SparseStructureFlow, GoldenNumbersWithBothAdapters) {
  const Velocity velocity = run_flow(filled_flow(tiny_flow_options()));
  test::expect_statistics(velocity.shape,
                          {-0.1048996, -0.115071, -0.07347682, -0.01890289, -0.3692214, -0.382603, 58.82098, 106.0869});
  test::expect_statistics(velocity.skeleton, {-0.006565571, -0.0428463, -0.0938572, -0.1285243, -0.3232489, -0.3733594,
                                              -48.32705, 44.6179});
}

// The stream that the duet has, too, when nothing comes back from the skeleton.
TEST(SparseStructureFlow, GeometryAloneIsTheShapeStreamWithoutItsPartner) {
  SparseStructureFlowOptions options = tiny_flow_options();
  options.adapter_skl_to_ss = false;
  SparseStructureFlow duet = filled_flow(options);
  options.geometry_only = true;
  EXPECT_EQ(SparseStructureFlowOptions::from_json(options.to_json()).to_json(), options.to_json());
  EXPECT_FALSE(tiny_flow_options().to_json().contains("geometry_only")) << "published configs stay as they are";
  SparseStructureFlow alone(options, nn::Init::kNone);
  const auto all = duet->named_parameters();
  const torch::NoGradGuard no_grad;
  for (auto& parameter : alone->named_parameters()) {
    EXPECT_EQ(parameter.key().find("_skl"), std::string::npos) << parameter.key();
    parameter.value().copy_(all[parameter.key()]);
  }
  const Velocity both = run_flow(duet), one = run_flow(alone);
  EXPECT_TRUE(torch::equal(one.shape, both.shape));
  EXPECT_EQ(one.skeleton.abs().max().item<double>(), 0.0);
  EXPECT_EQ(one.skeleton.sizes(), both.skeleton.sizes());
  options.predict_x0 = true;
  SparseStructureFlow predicting(options, nn::Init::kPublished);
  EXPECT_EQ(run_flow(predicting).shape.sizes(), both.shape.sizes());
}

TEST(SparseStructureFlow, GoldenNumbersWithLora) {
  SparseStructureFlowOptions options = tiny_flow_options();
  options.use_lora_ss = true;
  const Velocity velocity = run_flow(filled_flow(options));
  test::expect_statistics(velocity.shape,
                          {-0.1045261, -0.1146809, -0.0730335, -0.01841632, -0.3691498, -0.3825245, 58.7989, 105.8783});
  test::expect_statistics(velocity.skeleton, {-0.006052874, -0.04246879, -0.09356873, -0.1282577, -0.3229988, -0.373131,
                                              -48.30444, 44.64676});
}

TEST(SparseStructureFlow, GoldenNumbersWithOneAdapter) {
  SparseStructureFlowOptions options = tiny_flow_options();
  options.adapter_skl_to_ss = false;
  const Velocity velocity = run_flow(filled_flow(options));
  test::expect_statistics(velocity.shape,
                          {-0.3092945, -0.3275911, -0.2574761, -0.182135, -0.274856, -0.2201659, 65.79754, 90.67117});
  test::expect_statistics(velocity.skeleton, {0.06325293, 0.005595833, -0.05803882, -0.0962875, -0.2803437, -0.3329267,
                                              -41.04142, 43.8881});
}

TEST(SparseStructureFlow, PublishedSizesHaveThePublishedKeys) {
  for (const bool lora : {false, true}) {
    SparseStructureFlow model(published_flow_options(lora), nn::Init::kNone);  // reserves memory, touches none
    std::int64_t keys = 0, lora_keys = 0, parameters = 0;
    for (const nn::StateEntry& entry : nn::state_entries(*model)) {
      const bool is_lora = entry.key.find(".lora_") != std::string::npos;
      ++keys;
      lora_keys += is_lora ? 1 : 0;
      parameters += is_lora || entry.is_buffer ? 0 : entry.tensor.numel();
    }
    EXPECT_EQ(keys, lora ? 1250 : 1074);
    EXPECT_EQ(lora_keys, lora ? 176 : 0);
    EXPECT_EQ(parameters, 1161459724);
  }
}

TEST(SparseStructureFlow, FreshModelAnswersZero) {
  torch::manual_seed(3);
  SparseStructureFlow model(tiny_flow_options());
  const Velocity velocity = run_flow(model);
  EXPECT_EQ(velocity.shape.abs().max().item<double>(), 0.0);
  EXPECT_EQ(velocity.skeleton.abs().max().item<double>(), 0.0);
  for (const nn::StateEntry& entry : nn::state_entries(*model)) EXPECT_TRUE(entry.tensor.isfinite().all().item<bool>());
}

TEST(SparseStructureFlow, StreamsMeetOnlyThroughTheirAdapters) {
  FlowInputs other;
  other.x = -other.x;
  FlowInputs other_skl;
  other_skl.x_skl = -other_skl.x_skl;
  for (const bool to_skl : {false, true}) {
    for (const bool to_ss : {false, true}) {
      SparseStructureFlowOptions options = tiny_flow_options();
      options.adapter_ss_to_skl = to_skl;
      options.adapter_skl_to_ss = to_ss;
      SparseStructureFlow model = filled_flow(options);
      const Velocity base = run_flow(model);
      EXPECT_EQ(flow_difference(base.skeleton, run_flow(model, other).skeleton) > 0.0, to_skl);
      EXPECT_EQ(flow_difference(base.shape, run_flow(model, other_skl).shape) > 0.0, to_ss);
    }
  }
}

TEST(SparseStructureFlow, EveryVariantKeepsTheShapeOfItsInputs) {
  std::vector<SparseStructureFlowOptions> variants(7, tiny_flow_options());
  variants[0].patch_size = 2;
  variants[1].share_mod = true;
  variants[2].skl_cross_from_ss = true;
  variants[3].predict_x0 = variants[3].predict_x0_skl = true;
  variants[4].z_skl_is_global = true;
  variants[4].cross_adapter_every = 2;
  variants[5].z_is_global = true;  // fewer blocks than cross_adapter_every: after the last one
  variants[6].qk_rms_norm_cross = true;
  for (std::size_t i = 0; i < variants.size(); ++i) {
    variants[i].global_token_num = 5;
    variants[i].global_token_num_skl = 7;
    variants[i].validate();
    SparseStructureFlow model = filled_flow(variants[i]);
    FlowInputs inputs;
    inputs.x = test::wave(model->shape_latent_size(2), 0.11, 0.0);
    inputs.x_skl = test::wave(model->skeleton_latent_size(2), 0.17, 0.3);
    for (const std::int64_t window : {0, 2}) {
      const nn::AttentionWindows windows(window);
      const Velocity velocity = run_flow(model, inputs);
      EXPECT_EQ(velocity.shape.sizes(), inputs.x.sizes()) << i;
      EXPECT_EQ(velocity.skeleton.sizes(), inputs.x_skl.sizes()) << i;
      EXPECT_TRUE(velocity.shape.isfinite().all().item<bool>()) << i;
    }
  }
}

TEST(SparseStructureFlow, OneConditionServesAllItems) {
  SparseStructureFlow model = filled_flow(tiny_flow_options());
  FlowInputs one, repeated;
  one.cond = one.cond.narrow(0, 0, 1);
  repeated.cond = one.cond.repeat({2, 1, 1});
  EXPECT_LT(flow_difference(run_flow(model, one).shape, run_flow(model, repeated).shape), 1e-6);
}

TEST(SparseStructureFlow, FreezesTheShapeStreamButNotItsLora) {
  SparseStructureFlowOptions options = tiny_flow_options();
  options.freeze_pretrain_branch = true;
  options.use_lora_ss = true;
  SparseStructureFlow model(options, nn::Init::kNone);
  const auto parameters = model->named_parameters();
  EXPECT_FALSE(parameters["blocks.0.mlp.mlp.0.weight"].requires_grad());
  EXPECT_FALSE(parameters["t_embedder.mlp.0.weight"].requires_grad());
  EXPECT_FALSE(parameters["out_layer.bias"].requires_grad());
  EXPECT_TRUE(parameters["blocks.0.cross_attn.to_q.lora_A"].requires_grad());
  EXPECT_TRUE(parameters["blocks_skl.0.mlp.mlp.0.weight"].requires_grad());
  EXPECT_TRUE(parameters["t_embedder_skl.mlp.0.weight"].requires_grad());
  EXPECT_TRUE(parameters["adapter_skl_to_ss_layers.0.weight"].requires_grad());
  options.use_pretrain_branch = false;
  SparseStructureFlow unfrozen(options, nn::Init::kNone);
  for (const Tensor& parameter : unfrozen->parameters()) EXPECT_TRUE(parameter.requires_grad());
}

TEST(SparseStructureFlow, TorsoComputesInBfloat16) {
  SparseStructureFlowOptions options = tiny_flow_options();
  options.use_fp16 = true;
  SparseStructureFlow model = filled_flow(options);
  const Velocity full = run_flow(model);
  model->set_compute_dtype(torch::kBFloat16);
  test::expect_bfloat16_torso(model);
  const Velocity reduced = run_flow(model);
  EXPECT_EQ(reduced.shape.scalar_type(), torch::kFloat32);
  // Eight bits of mantissa through three blocks and the norm at the end; values are of size one.
  EXPECT_GT(flow_difference(full.shape, reduced.shape), 0.0);
  EXPECT_LT(flow_difference(full.shape, reduced.shape), 0.1);
  EXPECT_LT(flow_difference(full.skeleton, reduced.skeleton), 0.1);
  EXPECT_THROW(model->set_compute_dtype(torch::kHalf), NotSupportedError);
}

KERNEL_TEST(SparseStructureFlow, EightBitWeightsOfTheTorsoStayNear) {
  SparseStructureFlowOptions options = tiny_flow_options();
  options.model_channels = options.model_channels_skl = 64;
  options.use_lora_ss = true;
  SparseStructureFlow model = filled_flow(options);
  const Velocity exact = run_flow(model);
  model->set_compute_dtype(torch::kInt8);
  const auto parameters = model->named_parameters();
  EXPECT_EQ(parameters["blocks.0.self_attn.to_qkv.weight"].numel(), 0);
  EXPECT_GT(parameters["input_layer.weight"].numel(), 0) << "no part of the torso";
  const bool bf16 = nn::kernels::has_bf16_products();
  EXPECT_EQ(model->compute_dtype(), bf16 ? torch::kBFloat16 : torch::kFloat32);
  const Velocity rounded = run_flow(model);
  EXPECT_EQ(rounded.shape.scalar_type(), torch::kFloat32);
  // Rounding leaves about a hundredth of each product, and residual connections pass the rest on.
  EXPECT_LT(((rounded.shape - exact.shape).norm() / exact.shape.norm()).item<double>(), 0.02);
  EXPECT_LT(((rounded.skeleton - exact.skeleton).norm() / exact.skeleton.norm()).item<double>(), 0.02);
}

TEST(SparseStructureFlow, AttendsInsideWindowsWhileTheyLive) {
  const SparseStructureFlow model = filled_flow(tiny_flow_options());
  const Velocity full = run_flow(model);
  const auto differences = [&](std::int64_t window) {
    const nn::AttentionWindows windows(window);
    const Velocity found = run_flow(model);
    return std::pair(flow_difference(found.shape, full.shape), flow_difference(found.skeleton, full.skeleton));
  };
  const auto [shape, skeleton] = differences(8);  // even shifted by 4 the grid of 4³ is one window
  EXPECT_EQ(std::max(shape, skeleton), 0.0);
  const auto [windowed_shape, windowed_skeleton] = differences(2);
  EXPECT_GT(std::min(windowed_shape, windowed_skeleton), 1e-4);
  EXPECT_TRUE(torch::equal(run_flow(model).shape, full.shape));
}

// A model that is converted while its file is read computes the bits of one that is converted as a whole.
KERNEL_TEST(SparseStructureFlow, IsConvertedWhileItIsRead) {
  SparseStructureFlowOptions options = tiny_flow_options();
  options.model_channels = options.model_channels_skl = 64;
  const test::TemporaryFolder folder;
  for (const torch::Dtype dtype : {torch::kBFloat16, torch::kInt8}) {
    SparseStructureFlow whole = filled_flow(options), read(options, nn::Init::kNone);
    io::write_safetensors(folder / "flow.safetensors", nn::state_dict(*whole));
    nn::load_state_file(*read, folder / "flow.safetensors", read->conversion(dtype));
    whole->set_compute_dtype(dtype);
    EXPECT_EQ(read->compute_dtype(), whole->compute_dtype());
    const Velocity a = run_flow(whole), b = run_flow(read);
    EXPECT_TRUE(torch::equal(a.shape, b.shape)) << dtype;
    EXPECT_TRUE(torch::equal(a.skeleton, b.skeleton)) << dtype;
  }
}

TEST(SparseStructureFlow, NamesTheFileAndTheKeyOfAWeightThatEightBitsDoNotHold) {
  SparseStructureFlowOptions options = tiny_flow_options();
  options.model_channels = options.model_channels_skl = 64;
  SparseStructureFlow model = filled_flow(options), read(options, nn::Init::kNone);
  const std::string key = "blocks.1.self_attn.to_out.weight";
  model->named_parameters()[key].data()[2][3] = std::numeric_limits<float>::infinity();
  const test::TemporaryFolder folder;
  const auto file = folder / "flow.safetensors";
  io::write_safetensors(file, nn::state_dict(*model));
  try {
    nn::load_state_file(*read, file, read->conversion(torch::kInt8));
    FAIL() << "no error";
  } catch (const InputError& error) {
    EXPECT_EQ(error.what(), file.string() + ": " + key + ": a number is not finite");
  }
}

TEST(SparseStructureFlow, CheckpointingChangesMemoryAndNotGradients) {
  SparseStructureFlowOptions options = tiny_flow_options();
  options.use_lora_ss = true;  // frozen blocks before the first trainable input: only LoRA asks for gradients there
  const FlowInputs inputs;
  std::vector<Tensor> gradients;
  for (const bool checkpointing : {false, true}) {
    options.use_checkpoint = checkpointing;
    SparseStructureFlow model = filled_flow(options);
    const Velocity velocity = model->forward(inputs.x, inputs.x_skl, inputs.t, inputs.cond);
    (velocity.shape.square().sum() + velocity.skeleton.square().sum()).backward();
    std::vector<Tensor> list;
    for (const Tensor& parameter : model->parameters()) {
      if (parameter.requires_grad()) list.push_back(parameter.grad().flatten());
    }
    gradients.push_back(torch::cat(list));
  }
  const double size = gradients[0].abs().max().item<double>();
  EXPECT_GT(size, 0.0);
  EXPECT_LT(flow_difference(gradients[0], gradients[1]), 1e-5 * size);
}

TEST(SparseStructureFlow, RefusesInputsOfAnotherShape) {
  SparseStructureFlow model = filled_flow(tiny_flow_options());
  std::vector<FlowInputs> wrong(5);
  wrong[0].x = torch::zeros({2, 4, 4, 4, 4});
  wrong[1].x_skl = torch::zeros({2, 4, 4, 4, 5});
  wrong[2].x_skl = torch::zeros({1, 4, 4, 4, 4});
  wrong[3].t = torch::zeros({3});
  wrong[4].cond = torch::zeros({2, 5, 19});
  for (const FlowInputs& inputs : wrong) EXPECT_THROW(run_flow(model, inputs), InputError);
}

std::string flow_option_message(const std::string& changes) {
  Json json = tiny_flow_options().to_json();
  json.update(Json::parse(changes));
  try {
    SparseStructureFlowOptions::from_json(json, "flow.json", "/models/denoiser/args");
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(SparseStructureFlowOptions, RoundTripsAndNamesMistakes) {
  const Json json = published_flow_options(true).to_json();
  EXPECT_EQ(SparseStructureFlowOptions::from_json(json).to_json(), json);
  EXPECT_NE(flow_option_message(R"({"adapter_ss_to_sk": true})").find("adapter_ss_to_skl"), std::string::npos);
  EXPECT_NE(flow_option_message(R"({"num_heads": 5})").find("model_channels"), std::string::npos);
  EXPECT_NE(flow_option_message(R"({"patch_size": 3})").find("patch_size"), std::string::npos);
  EXPECT_NE(flow_option_message(R"({"num_blocks": 0})").find("num_blocks"), std::string::npos);
  EXPECT_NE(flow_option_message(R"({"predict_x0": true, "out_channels": 4})").find("predict_x0"), std::string::npos);
  EXPECT_NE(flow_option_message(R"({"pe_mode": "rope"})").find("not supported"), std::string::npos);
  EXPECT_THROW(SparseStructureFlowOptions::from_json(Json::object()), InputError);
  EXPECT_EQ(flow_option_message(R"({"num_heads": null, "num_head_channels": 8})"), "");
}

TEST(SparseStructureFlowFlops, EqualAHandCount) {
  SparseStructureFlowOptions options = tiny_flow_options();
  options.resolution = 2;  // 8 tokens
  options.model_channels = 4;
  options.model_channels_skl = 2;
  options.cond_channels = 3;
  options.num_heads = 1;
  options.num_blocks = 1;
  options.mlp_ratio = 2.0;
  const nn::FlopCount count = forward_flops(options, 2, 5);
  // input, output, time, modulation, qkv, out, cross q, kv, out, mlp twice, adapter; multiplications per batch item
  const double shape = 8 * 8 * 4 + 8 * 4 * 8 + 256 * 4 + 4 * 4 + 4 * 24 + 8 * 4 * 12 + 8 * 4 * 4 + 8 * 4 * 4 +
                       5 * 3 * 8 + 8 * 4 * 4 + 8 * 4 * 8 + 8 * 8 * 4 + 8 * 2 * 4;
  const double skeleton = 8 * 4 * 2 + 8 * 2 * 4 + 256 * 2 + 2 * 2 + 2 * 12 + 8 * 2 * 6 + 8 * 2 * 2 + 8 * 2 * 2 +
                          5 * 3 * 4 + 8 * 2 * 2 + 8 * 2 * 4 + 8 * 4 * 2 + 8 * 4 * 2;
  EXPECT_EQ(count.linear, 2.0 * 2.0 * (shape + skeleton));
  // scores and weighted sums, over 8 own and 5 condition tokens
  EXPECT_EQ(count.attention, 2.0 * 2.0 * (2 * 8 * (8 + 5) * 4 + 2 * 8 * (8 + 5) * 2));
}

TEST(SparseStructureFlowFlops, PublishedModelTakesElevenTeraflop) {
  const nn::FlopCount count = forward_flops(published_flow_options(false), 1, 1374);
  EXPECT_NEAR(count.total(), 10.9e12, 0.1e12);
  EXPECT_GT(forward_flops(published_flow_options(true), 1, 1374).total(), count.total());
}

}  // namespace
}  // namespace anigen::sparse_structure
