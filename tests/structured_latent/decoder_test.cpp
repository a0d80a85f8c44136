#include <gtest/gtest.h>
#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/nn/embeddings.h"
#include "anigen/nn/state_dict.h"
#include "anigen/skeleton_field/loss.h"
#include "anigen/structured_latent/decoder.h"
#include "anigen/structured_latent/encoder.h"
#include "tests/structured_latent/small_structured_latents.h"
#include "tests/vision/deterministic_fill.h"

// Sums of the published system at full width (docs/reference/autoencoders.md, 6).

namespace anigen::structured_latent {

namespace {

using sparse::SparseTensor;
using torch::Tensor;

struct LatentBatch {
  SparseTensor z, z_skl;
  std::vector<skeleton_field::SkeletonTensors> skeletons;
};

LatentBatch latent_batch(const std::vector<std::int64_t>& surface = {7, 4}) {
  const std::vector<std::int64_t> skeleton{5, 6};
  LatentBatch batch{{test::drawn_voxels(surface), {}}, {test::drawn_voxels(skeleton), {}}, {}};
  batch.z.feats = torch::randn({batch.z.support->size(), 7});
  batch.z_skl.feats = torch::randn({batch.z_skl.support->size(), 2});
  batch.skeletons = test::skeletons_of(test::small_rigs({3, 4}));
  return batch;
}

TEST(StructuredLatentDecoder, FieldsOnTheirSupports) {
  torch::manual_seed(1);
  StructuredLatentDecoder decoder = test::small_slat_decoder(test::small_slat_decoder_json());
  const LatentBatch batch = latent_batch();
  const torch::NoGradGuard no_grad;
  const auto decoded = decoder->forward(batch.z, batch.z_skl, batch.skeletons);
  EXPECT_EQ(decoded.mesh.support, batch.z.support->subdivided()->subdivided());
  EXPECT_EQ(decoded.mesh.feats.sizes(), torch::IntArrayRef({64 * 11, 53 + 48 + 24}));
  EXPECT_EQ(decoder->mesh_options().channels(), 125);
  EXPECT_EQ(decoder->mesh_options().resolution, 32);
  EXPECT_EQ(decoded.skeleton.feats.sizes(), torch::IntArrayRef({11, 8 + 3}));
  EXPECT_EQ(decoded.skin_coarse.sizes(), torch::IntArrayRef({11, 32}));
  ASSERT_EQ(decoded.skeletons.size(), 2u);
  const skeleton_field::SkeletonField& field = decoded.skeletons[1];
  EXPECT_TRUE(torch::allclose(field.positions, batch.z_skl.support->centers(8).slice(0, 5)));
  // Fresh heads say nearly nothing: votes at the centres, confidences of a half.
  EXPECT_TRUE(torch::allclose(field.joints, field.positions, 0.0, 0.01));
  EXPECT_TRUE(torch::allclose(field.conf_p, torch::full({6, 1}, 0.5), 0.0, 0.01));
  EXPECT_TRUE(torch::equal(field.conf_skin, field.conf_j));
  EXPECT_EQ(decoded.joint_features[1].features.sizes(), torch::IntArrayRef({4, 3}));
  EXPECT_EQ(decoder->extract_meshes(decoded, false).size(), 2u);
}

TEST(StructuredLatentDecoder, ShapesAloneAreThoseOfWholeRigs) {
  torch::manual_seed(6);
  StructuredLatentDecoder decoder = test::small_slat_decoder(test::small_slat_decoder_json());
  const LatentBatch batch = latent_batch();
  const torch::NoGradGuard no_grad;
  for (auto& parameter : decoder->named_parameters())
    parameter.value().add_(torch::randn_like(parameter.value()) * 0.05);
  const auto whole = decoder->extract_meshes(decoder->forward(batch.z, batch.z_skl, batch.skeletons), false);
  const auto alone =
      decoder->decode_shapes(batch.z.with(batch.z.feats.slice(1, 0, decoder->options().latent_channels)));
  ASSERT_EQ(alone.size(), whole.size());
  for (std::size_t i = 0; i < whole.size(); ++i) {
    ASSERT_TRUE(whole[i].success && alone[i].success);
    EXPECT_TRUE(torch::equal(alone[i].faces, whole[i].faces));
    EXPECT_TRUE(torch::equal(alone[i].vertices, whole[i].vertices));
    EXPECT_TRUE(torch::equal(alone[i].attributes, whole[i].attributes));
    EXPECT_FALSE(alone[i].skin_features.defined());
  }
  EXPECT_THROW(decoder->decode_shapes(batch.z), InputError) << "geometry channels alone";
}

// Offsets from voxels to their nearest joint and to its parent, as a perfect decoder would give them.
TEST(StructuredLatentDecoder, VotesInvertTheField) {
  torch::manual_seed(10);
  SkeletonHeadLayout layout(StructuredLatentDecoderOptions::from_json(test::small_slat_decoder_json()));
  ASSERT_TRUE(layout.residual);
  ASSERT_TRUE(layout.on_center);
  const sparse::SupportPtr voxels = test::drawn_voxels({40, 25}, layout.resolution);
  const std::vector<Tensor> centers = voxels->items().split(voxels->centers(layout.resolution));
  const RiggedMeshes rigs = test::small_rigs({5, 3});
  std::vector<Tensor> joints, parents, raw;
  for (std::size_t i = 0; i < 2; ++i) {
    const auto targets = skeleton_field::skeleton_targets(centers[i], rigs.joints[i], rigs.parents[i]);
    joints.push_back(rigs.joints[i].index_select(0, targets.joint));
    parents.push_back(rigs.joints[i].index_select(0, targets.parent));
    const Tensor others =
        torch::randn({centers[i].size(0), layout.joint_channels() - 6 + layout.skin_feature_channels()});
    raw.push_back(torch::cat({joints[i] - centers[i], parents[i] - centers[i], others}, 1));
  }
  const SparseTensor field{voxels, torch::cat(raw, 0)};
  const std::vector<skeleton_field::SkeletonField> votes = skeleton_fields(field, layout);
  layout.residual = false;
  const std::vector<skeleton_field::SkeletonField> plain = skeleton_fields(field, layout);
  ASSERT_EQ(votes.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_TRUE(torch::allclose(votes[i].positions, centers[i], 0.0, 1e-7));
    // Two roundings of numbers below 1.
    EXPECT_TRUE(torch::allclose(votes[i].joints, joints[i], 0.0, 2e-7));
    EXPECT_TRUE(torch::allclose(votes[i].parents, parents[i], 0.0, 2e-7));
    EXPECT_TRUE(torch::equal(plain[i].joints, raw[i].slice(1, 0, 3))) << "not residual: the votes themselves";
    EXPECT_TRUE(torch::equal(plain[i].parents, raw[i].slice(1, 3, 6)));
  }
}

TEST(StructuredLatentDecoder, AssetsOfABatchDoNotSeeEachOther) {
  torch::manual_seed(2);
  Json json = test::small_slat_decoder_json();
  json["h_skin_unet_num_levels"] = 2;
  json["skin_cross_from_groupped"] = true;
  StructuredLatentDecoder decoder = test::small_slat_decoder(json);
  test::stir(*decoder, 0.05);
  const LatentBatch batch = latent_batch();
  const torch::NoGradGuard no_grad;
  const auto together = decoder->forward(batch.z, batch.z_skl, batch.skeletons);
  for (std::size_t i = 0; i < 2; ++i) {
    const auto alone = [&](const SparseTensor& x) {
      Tensor coords = x.support->items().split(x.support->coords())[i].clone();
      coords.select(1, 0).zero_();
      return SparseTensor{sparse::Support::create(coords), x.support->items().split(x.feats)[i]};
    };
    const auto decoded = decoder->forward(alone(batch.z), alone(batch.z_skl), {batch.skeletons[i]});
    const Tensor mesh = together.mesh.support->items().split(together.mesh.feats)[i];
    EXPECT_TRUE(torch::allclose(mesh, decoded.mesh.feats, 1e-3, 1e-4 * mesh.abs().max().item<double>()));
    EXPECT_TRUE(torch::allclose(together.skeletons[i].joints, decoded.skeletons[0].joints, 1e-4, 1e-4));
  }
}

TEST(StructuredLatentDecoder, GradientMatchesFiniteDifferences) {
  torch::manual_seed(3);
  Json all = test::small_slat_decoder_json();
  for (const char* key : {"skin_cross_from_geo", "skl_cross_from_geo", "skin_skl_cross", "normalize_z", "upsample_skl",
                          "skin_cross_from_groupped", "use_checkpoint"}) {
    all[key] = true;
  }
  all["skl_defined_on_center"] = false;
  all["h_skin_unet_num_levels"] = 1;
  for (const Json& json : {test::small_slat_decoder_json(), all}) {
    StructuredLatentDecoder decoder = test::small_slat_decoder(json);
    test::stir(*decoder, 0.05);
    decoder->to(torch::kFloat64);
    LatentBatch batch = latent_batch({3, 1});
    Tensor z = batch.z.feats.to(torch::kFloat64).requires_grad_(), z_skl = batch.z_skl.feats.to(torch::kFloat64);
    z_skl.requires_grad_();
    const auto loss = [&] {
      const auto decoded = decoder->forward(batch.z.with(z), batch.z_skl.with(z_skl), batch.skeletons);
      Tensor sum = decoded.mesh.feats.square().mean();
      for (std::size_t i = 0; i < 2; ++i) {
        const skeleton_field::SkeletonField& field = decoded.skeletons[i];
        sum = sum + field.joints.square().mean() + field.parents.square().mean() + field.conf_p.square().mean() +
              decoded.joint_features[i].variance;
        const Tensor weights =
            decoder->skin_weights(field.skin_features, decoded.joints[i], decoded.joint_features[i].features, 1 << 14);
        sum = sum + weights.select(1, 0).square().mean();
      }
      return sum;
    };
    std::vector<Tensor> moved = decoder->parameters();
    moved.push_back(z);
    moved.push_back(z_skl);
    test::expect_gradient_of(moved, loss, 1e-4);
  }
}

TEST(StructuredLatentDecoder, FrozenGeometryLeavesNoGraph) {
  torch::manual_seed(4);
  Json json = test::small_slat_decoder_json();
  json["use_pretrain_branch"] = true;
  json["modules_to_freeze"] = Json::array({"input_layer", "blocks", "upsample", "out_layer", "skin_decoder"});
  StructuredLatentDecoder decoder = test::small_slat_decoder(json);
  for (const nn::StateEntry& entry : nn::state_entries(*decoder)) {
    const std::string module = entry.key.substr(0, entry.key.find('.'));
    const bool frozen = module == "input_layer" || module == "blocks" || module == "upsample" ||
                        module == "out_layer" || module == "skin_decoder";
    EXPECT_EQ(entry.tensor.requires_grad(), !frozen) << entry.key;
  }
  const LatentBatch batch = latent_batch();
  const Tensor geometry = batch.z.feats.slice(1, 0, 3), skin = batch.z.feats.slice(1, 3).clone().requires_grad_();
  const auto decoded = decoder->forward({batch.z.with(geometry), batch.z.with(skin), batch.z_skl}, batch.skeletons);
  decoded.mesh.feats.sum().backward();
  EXPECT_GT(skin.grad().abs().sum().item<double>(), 0.0);
  EXPECT_FALSE(geometry.requires_grad());
}

TEST(StructuredLatentDecoder, SkinWeightsDoNotDependOnTheChunks) {
  torch::manual_seed(5);
  for (const std::int64_t cross : {0, 1}) {
    Json json = test::small_slat_decoder_json();
    json["skin_decoder_config"]["vert_cross_blocks_num"] = cross;
    StructuredLatentDecoder decoder = test::small_slat_decoder(json);
    test::stir(*decoder->skin_decoder());
    const skeleton_field::SkeletonTensors skeleton{torch::randn({5, 3}), torch::tensor({1, 4, -1, 2, 2})};
    const Tensor points = torch::randn({53, 3}), joints = torch::randn({5, 3});
    const torch::NoGradGuard no_grad;
    const Tensor whole = decoder->skin_weights(points, skeleton, joints);
    EXPECT_TRUE(torch::allclose(whole.sum(1), torch::ones({53})));
    const skin_field::SkeletonBatch batch =
        skin_field::SkeletonBatch::from_lists({skeleton.joints}, {skeleton.parents});
    const Tensor direct =
        decoder->skin_decoder()->decode(points, nn::Ragged(std::vector<std::int64_t>{53}), joints, batch)[0];
    EXPECT_TRUE(torch::allclose(whole, direct, 1e-5, 1e-6));
    for (const std::int64_t bytes : {0, 2000, 9000})
      EXPECT_TRUE(torch::allclose(decoder->skin_weights(points, skeleton, joints, bytes), whole, 1e-5, 1e-6));
    EXPECT_EQ(decoder->skin_weights(points.slice(0, 0, 0), skeleton, joints).sizes(), torch::IntArrayRef({0, 5}));
    EXPECT_THROW(decoder->skin_weights(points.slice(1, 0, 2), skeleton, joints), InputError);
    EXPECT_THROW(decoder->skin_weights(points, skeleton, joints.slice(0, 0, 4)), InputError);
    EXPECT_THROW(
        decoder->skin_weights(points, {torch::zeros({0, 3}), torch::zeros({0}, torch::kInt64)}, joints.slice(0, 0, 0)),
        InputError);
    EXPECT_THROW(decoder->skin_weights(points, {skeleton.joints, torch::tensor({1, 5, -1, 2, 2})}, joints), InputError);
  }
}

TEST(StructuredLatentDecoder, GroupsItsOwnVotesUnlessToldOtherwise) {
  torch::manual_seed(6);
  StructuredLatentDecoder decoder = test::small_slat_decoder(test::small_slat_decoder_json());
  const LatentBatch batch = latent_batch();
  const torch::NoGradGuard no_grad;
  const auto grouped = decoder->forward(batch.z, batch.z_skl);
  const skeleton_field::SkeletonTensors own = skeleton_field::group_votes(grouped.skeletons[1], "mean_shift");
  EXPECT_TRUE(torch::equal(grouped.joints[1].joints, own.joints));
  EXPECT_TRUE(torch::equal(grouped.joints[1].parents, own.parents));
  int asked = 0;
  decoder->group_with([&](const skeleton_field::SkeletonField& field) {
    ++asked;
    return skeleton_field::SkeletonTensors{field.joints.slice(0, 0, 1), torch::tensor({-1})};
  });
  EXPECT_EQ(decoder->forward(batch.z, batch.z_skl).joints[0].joints.size(0), 1);
  EXPECT_EQ(asked, 2);
  decoder->group_with({});
  EXPECT_TRUE(torch::equal(decoder->forward(batch.z, batch.z_skl).joints[1].joints, own.joints));
}

TEST(StructuredLatentDecoder, Precision) {
  torch::manual_seed(7);
  Json json = test::small_slat_decoder_json();
  for (const char* key : {"use_fp16", "upsample_skl", "skin_cross_from_groupped"}) json[key] = true;
  json["h_skin_unet_num_levels"] = 1;
  StructuredLatentDecoder decoder = test::small_slat_decoder(json);
  const std::vector<torch::Dtype> dtypes = nn::published_dtypes(*decoder, decoder->half_precision_modules());
  const std::vector<nn::StateEntry> entries = nn::state_entries(*decoder);
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const std::string& key = entries[i].key;
    if (key.find("h_skin_unet") == 0) {
      EXPECT_EQ(dtypes[i], torch::kFloat32) << key;
    }
    if (key.find("upsample") == 0) {
      EXPECT_EQ(dtypes[i] == torch::kHalf, key.find(".conv.") != std::string::npos) << key;
    }
  }
  EXPECT_THROW(decoder->convert_to_fp16(), NotSupportedError);
  const LatentBatch batch = latent_batch();
  const torch::NoGradGuard no_grad;
  const Tensor wide = decoder->forward(batch.z, batch.z_skl, batch.skeletons).skin_coarse;
  decoder->set_torso_dtype(torch::kBFloat16);
  const auto narrow = decoder->forward(batch.z, batch.z_skl, batch.skeletons);
  EXPECT_EQ(narrow.mesh.feats.scalar_type(), torch::kFloat32);
  EXPECT_EQ(narrow.skeleton.feats.scalar_type(), torch::kFloat32);
  EXPECT_LT((wide - narrow.skin_coarse).abs().max().item<double>(), 0.1 * wide.abs().max().item<double>());
}

TEST(StructuredLatentDecoder, BadInputIsNamed) {
  torch::manual_seed(8);
  StructuredLatentDecoder decoder = test::small_slat_decoder(test::small_slat_decoder_json());
  const auto message = [&](const auto& change) {
    LatentBatch batch = latent_batch();
    change(batch);
    try {
      decoder->forward(batch.z, batch.z_skl, batch.skeletons);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  const auto expect_named = [&](const char* words, const auto& change) {
    EXPECT_NE(message(change).find(words), std::string::npos) << words << ": " << message(change);
  };
  expect_named("7 channels", [](LatentBatch& b) { b.z.feats = b.z.feats.slice(1, 1); });
  expect_named("2 channels", [](LatentBatch& b) { b.z_skl.feats = b.z_skl.feats.slice(0, 1); });
  expect_named("not finite", [](LatentBatch& b) { b.z_skl.feats[2][0] = INFINITY; });
  expect_named("assets", [](LatentBatch& b) { b.z_skl = {test::drawn_voxels({4}), torch::randn({4, 2})}; });
  expect_named("outside a grid of 8", [](LatentBatch& b) {
    b.z = {sparse::Support::create(torch::tensor({0, 9, 0, 0, 1, 0, 0, 0}).view({2, 4})), torch::randn({2, 7})};
  });
  expect_named("1 are given for 2", [](LatentBatch& b) { b.skeletons.pop_back(); });
  expect_named("skeleton 1", [](LatentBatch& b) { b.skeletons[1].parents[0] = 4; });
}

}  // namespace

namespace {

using torch::Tensor;

// Sums agree to a few millionths of the sum of magnitudes, single numbers to fp32 rounding of deep sums.
void expect_golden_rows(const char* what, const Tensor& tensor, double sum, double abs_sum,
                        const std::vector<double>& first) {
  SCOPED_TRACE(what);
  const Tensor values = tensor.detach().to(torch::kFloat64).flatten();
  EXPECT_NEAR(values.sum().item<double>(), sum, 5e-6 * abs_sum);
  EXPECT_NEAR(values.abs().sum().item<double>(), abs_sum, 5e-6 * abs_sum);
  for (std::size_t i = 0; i < first.size(); ++i)
    EXPECT_NEAR(values[static_cast<std::int64_t>(i)].item<double>(), first[i], 1e-4) << i;
}

// Cells of a 16³ grid in a shell around its middle: squares of odd distances, a fifth of them left out.
sparse::SupportPtr shell_voxels(std::int64_t least, std::int64_t most) {
  const Tensor cells = nn::grid_coordinates(16);
  const Tensor distance = (2 * cells + 1 - 16).square().sum(1);
  const Tensor pattern = (7 * cells.select(1, 0) + 13 * cells.select(1, 1) + 29 * cells.select(1, 2)).remainder(5);
  const Tensor chosen = (distance >= least).logical_and(distance <= most).logical_and(pattern != 0);
  const Tensor rows = cells.index_select(0, chosen.nonzero().flatten());
  return sparse::Support::create(torch::cat({torch::zeros({rows.size(0), 1}, torch::kInt64), rows}, 1));
}

Json published_widths() {
  return Json::parse(R"({
    "resolution": 16, "model_channels": 768, "model_channels_skl": 512, "model_channels_skin": 512,
    "latent_channels": 8, "latent_channels_skl": 4, "latent_channels_vertskin": 8, "num_blocks": 12, "num_heads": 12,
    "num_heads_skl": 16, "num_heads_skin": 16, "attn_mode_cross": "swin", "use_fp16": true,
    "skin_cross_from_geo": false, "skl_cross_from_geo": false, "skin_skl_cross": false, "jp_residual_fields": true,
    "jp_hyper_continuous": true})");
}

TEST(StructuredLatentEncoder, GoldenNumbersAtPublishedWidth) {
  const torch::NoGradGuard no_grad;
  Json json = published_widths();
  json["in_channels"] = 1024;
  json["skin_encoder_config"] = Json::parse(R"({
    "skin_feat_channels": 4, "skl_pos_embed_freq": 12, "jp_embed_dim": 1024,
    "jp_embedder_config": {"hidden_dim": 1024, "depth": 6, "jp_embed_attn": true}})");
  StructuredLatentEncoder encoder(StructuredLatentEncoderOptions::from_json(json), nn::Init::kNone);
  test::golden_fill(*encoder);
  const sparse::SupportPtr surface = shell_voxels(81, 164), skeleton = shell_voxels(0, 50);
  ASSERT_EQ(surface->size(), 582);
  ASSERT_EQ(skeleton->size(), 124);
  RiggedMeshes rigs;
  rigs.joints = {test::golden_tensor(1000006, {6, 3}, 0.4)};
  rigs.parents = {torch::tensor({-1, 0, 1, 1, 0, 4})};
  rigs.vertices = {test::golden_tensor(1000007, {40, 3}, 0.5)};
  const Tensor skin = test::golden_tensor(1000008, {40, 6}, 0.5, 0.5);
  rigs.skin = {skin / skin.sum(1, true)};
  const auto output = encoder->forward({surface, test::golden_tensor(1000005, {582, 1024})}, {skeleton, {}}, rigs);
  expect_golden_rows("skin input", output.x_skin, -119.259856, 16616.921992,
                     {-0.045806, 0.010563, 0.051327, -0.030025});
  expect_golden_rows("skeleton input", output.x_skl, 280.621711, 8464.844272,
                     {0.863187, 0.730405, -0.603460, -0.257974});
  expect_golden_rows("z", output.z.feats, 150.543961, 3919.239492, {0.777792, 1.012389, -1.253433, 0.543451});
  expect_golden_rows("logvar", output.logvar, -1853.019199, 5043.135651, {-1.139554, -1.401212, -1.344974, -0.816555});
  expect_golden_rows("z_skl", output.z_skl.feats, -94.279108, 220.663778, {-0.831477, 0.127792, 0.223238, -0.492423});
}

TEST(StructuredLatentDecoder, GoldenNumbersAtPublishedWidth) {
  const torch::NoGradGuard no_grad;
  Json json = published_widths();
  json["h_skin_unet_num_levels"] = -1;
  json["representation_config"] = {{"use_color", true}, {"use_conf_jp", true}};
  json["skin_decoder_config"] = Json::parse(R"({"skin_feat_channels": 4, "model_channels": 64, "num_blocks": 4})");
  StructuredLatentDecoder decoder(StructuredLatentDecoderOptions::from_json(json), nn::Init::kNone);
  test::golden_fill(*decoder);
  const skeleton_field::SkeletonTensors skeleton{torch::zeros({1, 3}), torch::tensor({-1})};
  const auto decoded = decoder->forward({shell_voxels(81, 164), test::golden_tensor(1000009, {582, 16}, 1.5)},
                                        {shell_voxels(0, 50), test::golden_tensor(1000010, {124, 4}, 1.5)}, {skeleton});
  const Tensor& mesh = decoded.mesh.feats;
  expect_golden_rows("mesh", mesh, 1730628.35, 13283946.51, {-2.259320, -0.718233, 7.573243, -1.140769});
  expect_golden_rows("sdf", mesh.slice(1, 0, 8), 29743.90, 727719.60, {});
  expect_golden_rows("deform", mesh.slice(1, 8, 32), 442354.66, 2375478.58, {5.159109, 1.169744, -7.222793, -2.710748});
  expect_golden_rows("weights", mesh.slice(1, 32, 53), 465179.58, 2064273.23,
                     {0.068924, -0.642007, 2.485815, 5.823055});
  expect_golden_rows("colour", mesh.slice(1, 53, 101), 741202.74, 4431431.21,
                     {-3.420218, 1.365393, -3.350893, 1.286824});
  expect_golden_rows("skin", mesh.slice(1, 101), 52147.47, 3685043.89, {-1.160782, -0.012298, 2.407611, -0.993306});
  expect_golden_rows("skeleton", decoded.skeleton.feats, -1449.086217, 5250.909193,
                     {-4.332098, 0.099323, 2.012015, 0.571186});
}

}  // namespace

}  // namespace anigen::structured_latent
