#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>

#include "anigen/core/error.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/nn/state_dict.h"
#include "anigen/nn/trainable.h"
#include "tests/structured_latent/small_structured_latents.h"

namespace anigen::structured_latent {
namespace {

using sparse::SparseTensor;
using torch::Tensor;

struct EncoderBatch {
  SparseTensor x, x_skl;
  RiggedMeshes rigs;

  /// One asset of it.
  EncoderBatch alone(std::int64_t item) const {
    const auto part = [&](const SparseTensor& tensor) {
      Tensor coords = tensor.support->items().split(tensor.support->coords())[static_cast<std::size_t>(item)].clone();
      coords.select(1, 0).zero_();
      return SparseTensor{sparse::Support::create(coords),
                          tensor.feats.defined()
                              ? tensor.support->items().split(tensor.feats)[static_cast<std::size_t>(item)]
                              : Tensor()};
    };
    const auto i = static_cast<std::size_t>(item);
    EncoderBatch batch{part(x), part(x_skl), {}};
    batch.rigs.joints = {rigs.joints[i]};
    batch.rigs.parents = {rigs.parents[i]};
    batch.rigs.skin = {rigs.skin[i]};
    batch.rigs.vertices = {rigs.vertices[i]};
    batch.rigs.faces = {rigs.faces[i]};
    return batch;
  }
};

EncoderBatch encoder_batch(const std::vector<std::int64_t>& joints = {3, 5}) {
  const std::vector<std::int64_t> surface{17, 9}, skeleton{6, 11};
  const auto first = [&](const std::vector<std::int64_t>& counts) {
    return std::vector<std::int64_t>(counts.begin(), counts.begin() + static_cast<std::ptrdiff_t>(joints.size()));
  };
  EncoderBatch batch{{test::drawn_voxels(first(surface)), {}}, {test::drawn_voxels(first(skeleton)), {}}, {}};
  batch.x.feats = torch::randn({batch.x.support->size(), 5});
  batch.rigs = test::small_rigs(joints);
  return batch;
}

TEST(StructuredLatentEncoder, LatentsOfTheTwoKinds) {
  torch::manual_seed(1);
  Json json = test::small_slat_encoder_json();
  json["normalize_scale"] = 1.5;
  StructuredLatentEncoder encoder = test::small_slat_encoder(json);
  test::stir(*encoder);
  const EncoderBatch batch = encoder_batch();
  const auto still = encoder->forward(batch.x, batch.x_skl, batch.rigs);
  EXPECT_EQ(still.z.feats.sizes(), torch::IntArrayRef({26, 7}));
  EXPECT_EQ(still.z_skl.feats.sizes(), torch::IntArrayRef({17, 2}));
  EXPECT_EQ(still.x_skin.size(1), 10);
  EXPECT_EQ(still.joints_pos[1].sizes(), torch::IntArrayRef({11, 4}));
  // Skin and skeleton lie on spheres and do not vary; geometry does.
  EXPECT_TRUE(torch::allclose(still.z_skin.norm(2, 1), torch::full({26}, 1.5)));
  EXPECT_TRUE(torch::allclose(still.z_skl.feats.norm(2, 1), torch::full({17}, 1.5)));
  EXPECT_TRUE(torch::equal(still.z.feats, torch::cat({still.z_geometry, still.z_skin}, 1)));
  EXPECT_FALSE(still.mean_skl.requires_grad());
  EXPECT_EQ(still.logvar.slice(1, 3).abs().max().item<double>(), 0.0);
  EXPECT_GT(still.logvar.slice(1, 0, 3).abs().max().item<double>(), 0.0);

  const Tensor noise = torch::randn({26, 3});
  const auto drawn = encoder->forward(batch.x, batch.x_skl, batch.rigs, {noise});
  EXPECT_TRUE(
      torch::allclose(drawn.z_geometry, still.z_geometry + torch::exp(0.5 * still.logvar.slice(1, 0, 3)) * noise));
  EXPECT_TRUE(torch::equal(drawn.z_skin, still.z_skin));
  EXPECT_THROW(encoder->forward(batch.x, batch.x_skl, batch.rigs, {noise, noise}), InputError);
  EXPECT_THROW(encoder->forward(batch.x, batch.x_skl, batch.rigs, {noise.slice(1, 0, 2)}), InputError);

  json["latent_denoising"] = false;
  StructuredLatentEncoder posterior = test::small_slat_encoder(json);
  const std::vector<Tensor> three{noise, torch::randn({26, 4}), torch::randn({17, 2})};
  const auto sampled = posterior->forward(batch.x, batch.x_skl, batch.rigs, three);
  EXPECT_TRUE(torch::allclose(sampled.z_skl.feats, sampled.mean_skl + torch::exp(0.5 * sampled.logvar_skl) * three[2]));
  EXPECT_TRUE(sampled.mean_skl.requires_grad());
  EXPECT_THROW(posterior->forward(batch.x, batch.x_skl, batch.rigs, {noise}), InputError);
}

TEST(StructuredLatentEncoder, AssetsOfABatchDoNotSeeEachOther) {
  torch::manual_seed(2);
  for (const char* mode : {"swin", "full"}) {
    Json json = test::small_slat_encoder_json();
    for (const char* key : {"attn_mode", "attn_mode_cross"}) json[key] = mode;
    for (const char* key : {"skin_skl_cross", "skin_cross_from_geo"}) json[key] = std::string(mode) == "full";
    StructuredLatentEncoder encoder = test::small_slat_encoder(json);
    test::stir(*encoder);
    const EncoderBatch batch = encoder_batch();
    const auto together = encoder->forward(batch.x, batch.x_skl, batch.rigs);
    for (std::int64_t item = 0; item < 2; ++item) {
      const EncoderBatch one = batch.alone(item);
      const auto alone = encoder->forward(one.x, one.x_skl, one.rigs);
      const auto i = static_cast<std::size_t>(item);
      EXPECT_TRUE(torch::allclose(batch.x.support->items().split(together.z.feats)[i], alone.z.feats, 1e-4, 1e-5));
      EXPECT_TRUE(
          torch::allclose(batch.x_skl.support->items().split(together.z_skl.feats)[i], alone.z_skl.feats, 1e-4, 1e-5));
    }
  }
}

TEST(StructuredLatentEncoder, GradientMatchesFiniteDifferences) {
  torch::manual_seed(3);
  Json json = test::small_slat_encoder_json();
  for (const char* key : {"skin_cross_from_geo", "skl_cross_from_geo", "skin_skl_cross", "qk_rms_norm"})
    json[key] = true;
  for (const bool recompute : {false, true}) {
    StructuredLatentEncoder encoder = test::small_slat_encoder(json);
    test::stir(*encoder);
    encoder->to(torch::kFloat64);
    encoder->recompute_blocks(recompute);
    EncoderBatch batch = encoder_batch();
    for (std::size_t i = 0; i < 2; ++i) {
      batch.rigs.surfaces.push_back(std::make_shared<geometry::NearestSurface>(
          std::vector<Eigen::Vector3f>{{-0.4F, -0.4F, -0.4F}, {0.4F, -0.4F, -0.3F}, {0, 0.4F, -0.4F}, {0, 0.1F, 0.4F}},
          std::vector<Triangle>{{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}}));
    }
    const std::vector<Tensor> noise{torch::randn({26, 3}, torch::kFloat64)};
    const Tensor factor = torch::randn({26, 7}, torch::kFloat64), factor_skl = torch::randn({17, 2}, torch::kFloat64);
    const auto loss = [&] {
      const auto latents = encoder->forward(batch.x, batch.x_skl, batch.rigs, noise);
      return (latents.z.feats * factor).sum() + (latents.z_skl.feats * factor_skl).sum() +
             latents.logvar.square().sum();
    };
    test::expect_gradient_of(encoder->parameters(), loss, 1e-5);
  }
}

TEST(StructuredLatentEncoder, ASingleJointHasNoSecond) {
  torch::manual_seed(4);
  StructuredLatentEncoder encoder = test::small_slat_encoder(test::small_slat_encoder_json());
  const EncoderBatch batch = encoder_batch({1});
  const auto output = encoder->forward(batch.x, batch.x_skl, batch.rigs);
  EXPECT_EQ(output.joints_pos[0].select(1, 3).abs().max().item<double>(), 0.0);
  EXPECT_TRUE(
      torch::allclose(output.joints_pos[0].slice(1, 0, 3), batch.rigs.joints[0] - batch.x_skl.support->centers(8)));
  EXPECT_TRUE(torch::isfinite(output.z_skl.feats).all().item<bool>());
}

TEST(StructuredLatentEncoder, FreshGeometryIsAStandardNormal) {
  torch::manual_seed(5);
  StructuredLatentEncoder encoder = test::small_slat_encoder(test::small_slat_encoder_json());
  const EncoderBatch batch = encoder_batch();
  const auto output = encoder->forward(batch.x, batch.x_skl, batch.rigs);
  EXPECT_EQ(output.z_geometry.abs().max().item<double>(), 0.0);
  EXPECT_EQ(output.logvar.abs().max().item<double>(), 0.0);
  EXPECT_GT(output.z_skin.abs().max().item<double>(), 0.0);
}

TEST(StructuredLatentEncoder, FreezesWhatIsNamed) {
  Json json = test::small_slat_encoder_json();
  json["use_pretrain_branch"] = true;
  StructuredLatentEncoder encoder(StructuredLatentEncoderOptions::from_json(json), nn::Init::kNone);
  for (const nn::StateEntry& entry : nn::state_entries(*encoder)) {
    const std::string module = entry.key.substr(0, entry.key.find('.'));
    const bool frozen =
        module == "input_layer" || module == "blocks" || module == "out_layer" || module == "skin_encoder";
    EXPECT_EQ(entry.tensor.requires_grad(), !frozen) << entry.key;
  }
  json["modules_to_freeze"] = Json::array({"all"});
  StructuredLatentEncoder still(StructuredLatentEncoderOptions::from_json(json), nn::Init::kNone);
  EXPECT_EQ(nn::frozen_parameters(*still).size(), nn::state_entries(*still).size());
}

TEST(StructuredLatentEncoder, FrozenGeometryLeavesNoGraph) {
  torch::manual_seed(6);
  Json json = test::small_slat_encoder_json();
  json["use_pretrain_branch"] = true;
  StructuredLatentEncoder encoder = test::small_slat_encoder(json);
  const EncoderBatch batch = encoder_batch();
  const auto output = encoder->forward(batch.x, batch.x_skl, batch.rigs);
  EXPECT_FALSE(output.z_geometry.requires_grad());
  EXPECT_TRUE(output.z_skin.requires_grad());
}

TEST(StructuredLatentEncoder, Precision) {
  torch::manual_seed(7);
  Json json = test::small_slat_encoder_json();
  json["use_fp16"] = true;
  json["normalize_z"] = false;
  StructuredLatentEncoder encoder = test::small_slat_encoder(json);
  EXPECT_EQ(encoder->half_precision_modules(),
            (std::vector<std::string>{"skin_encoder.joint_embedder.blocks", "blocks", "blocks_skin", "blocks_skl"}));
  EXPECT_THROW(encoder->convert_to_fp16(), NotSupportedError);
  const EncoderBatch batch = encoder_batch();
  const Tensor wide = encoder->forward(batch.x, batch.x_skl, batch.rigs).z_skl.feats;
  encoder->set_torso_dtype(torch::kBFloat16);
  const Tensor narrow = encoder->forward(batch.x, batch.x_skl, batch.rigs).z_skl.feats;
  EXPECT_EQ(narrow.scalar_type(), torch::kFloat32);
  EXPECT_LT((wide - narrow).abs().max().item<double>(), 0.2);  // 8 bits through two blocks, values about 1
  EXPECT_GT((wide - narrow).abs().max().item<double>(), 0.0);
}

TEST(StructuredLatentEncoder, BadInputIsNamed) {
  torch::manual_seed(8);
  StructuredLatentEncoder encoder = test::small_slat_encoder(test::small_slat_encoder_json());
  const auto message = [&](const auto& change) {
    EncoderBatch batch = encoder_batch();
    change(batch);
    try {
      encoder->forward(batch.x, batch.x_skl, batch.rigs);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  const auto expect_named = [&](const char* words, const auto& change) {
    EXPECT_NE(message(change).find(words), std::string::npos) << words << ": " << message(change);
  };
  expect_named("5 channels", [](EncoderBatch& b) { b.x.feats = b.x.feats.slice(1, 0, 4); });
  expect_named("voxel 3 has a value that is not finite", [](EncoderBatch& b) { b.x.feats[3][1] = NAN; });
  expect_named("outside a grid of 8", [](EncoderBatch& b) {
    b.x_skl.support = sparse::Support::create(torch::tensor({0, 1, 1, 1, 1, 0, 8, 0}).view({2, 4}));
  });
  expect_named("skeletons", [](EncoderBatch& b) { b.x_skl.support = test::drawn_voxels({3}); });
  expect_named("vertices", [](EncoderBatch& b) { b.rigs.vertices.pop_back(); });
  expect_named("skin", [](EncoderBatch& b) { b.rigs.skin[1] = b.rigs.skin[1].slice(1, 0, 2); });
  expect_named("skin of asset 1", [](EncoderBatch& b) { b.rigs.skin[1][0][0] = NAN; });
  expect_named("asset 0", [](EncoderBatch& b) { b.rigs.vertices[0] = torch::zeros({0, 3}); });
  expect_named("parent", [](EncoderBatch& b) { b.rigs.parents[0][2] = 7; });
  expect_named("no joints", [](EncoderBatch& b) {
    b.rigs.joints[0] = torch::zeros({0, 3});
    b.rigs.parents[0] = torch::zeros({0}, torch::kInt64);
  });
}

}  // namespace
}  // namespace anigen::structured_latent
