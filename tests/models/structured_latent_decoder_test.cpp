#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/models/state_dict.h"
#include "tests/models/small_structured_latents.h"

namespace anigen::models {
namespace {

using sparse::SparseTensor;
using torch::Tensor;

struct LatentBatch {
  SparseTensor z, z_skl;
  std::vector<fields::SkeletonTensors> skeletons;
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
  const fields::SkeletonField& field = decoded.skeletons[1];
  EXPECT_TRUE(torch::allclose(field.positions, batch.z_skl.support->centers(8).slice(0, 5)));
  // Fresh heads say nearly nothing: votes at the centres, confidences of a half.
  EXPECT_TRUE(torch::allclose(field.joints, field.positions, 0.0, 0.01));
  EXPECT_TRUE(torch::allclose(field.conf_p, torch::full({6, 1}, 0.5), 0.0, 0.01));
  EXPECT_TRUE(torch::equal(field.conf_skin, field.conf_j));
  EXPECT_EQ(decoded.joint_features[1].features.sizes(), torch::IntArrayRef({4, 3}));
  EXPECT_EQ(decoder->extract_meshes(decoded, false).size(), 2u);
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
        const fields::SkeletonField& field = decoded.skeletons[i];
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
  for (const StateEntry& entry : state_entries(*decoder)) {
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
    const fields::SkeletonTensors skeleton{torch::randn({5, 3}), torch::tensor({1, 4, -1, 2, 2})};
    const Tensor points = torch::randn({53, 3}), joints = torch::randn({5, 3});
    const torch::NoGradGuard no_grad;
    const Tensor whole = decoder->skin_weights(points, skeleton, joints);
    EXPECT_TRUE(torch::allclose(whole.sum(1), torch::ones({53})));
    const SkeletonBatch batch = SkeletonBatch::from_lists({skeleton.joints}, {skeleton.parents});
    const Tensor direct =
        decoder->skin_decoder()->decode(points, nn::Ragged(std::vector<std::int64_t>{53}), joints, batch)[0];
    EXPECT_TRUE(torch::allclose(whole, direct, 1e-5, 1e-6));
    for (const std::int64_t bytes : {0, 2000, 9000}) {
      EXPECT_TRUE(torch::allclose(decoder->skin_weights(points, skeleton, joints, bytes), whole, 1e-5, 1e-6));
    }
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
  const fields::SkeletonTensors own = fields::group_votes(grouped.skeletons[1], "mean_shift");
  EXPECT_TRUE(torch::equal(grouped.joints[1].joints, own.joints));
  EXPECT_TRUE(torch::equal(grouped.joints[1].parents, own.parents));
  int asked = 0;
  decoder->group_with([&](const fields::SkeletonField& field) {
    ++asked;
    return fields::SkeletonTensors{field.joints.slice(0, 0, 1), torch::tensor({-1})};
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
  const std::vector<torch::Dtype> dtypes = published_dtypes(*decoder, decoder->half_precision_modules());
  const std::vector<StateEntry> entries = state_entries(*decoder);
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
}  // namespace anigen::models
