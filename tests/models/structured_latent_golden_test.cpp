// Sums of the published system at full width (reference autoencoders.md, appendix B).
#include <gtest/gtest.h>

#include "anigen/models/structured_latent_decoder.h"
#include "anigen/models/structured_latent_encoder.h"
#include "anigen/nn/absolute_position.h"
#include "tests/models/deterministic_fill.h"

namespace anigen::models {
namespace {

using torch::Tensor;

// Sums agree to a few millionths of the sum of magnitudes, single numbers to fp32 rounding of deep sums.
void expect_golden_rows(const char* what, const Tensor& tensor, double sum, double abs_sum,
                        const std::vector<double>& first) {
  SCOPED_TRACE(what);
  const Tensor values = tensor.detach().to(torch::kFloat64).flatten();
  EXPECT_NEAR(values.sum().item<double>(), sum, 5e-6 * abs_sum);
  EXPECT_NEAR(values.abs().sum().item<double>(), abs_sum, 5e-6 * abs_sum);
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_NEAR(values[static_cast<std::int64_t>(i)].item<double>(), first[i], 1e-4) << i;
  }
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
  const fields::SkeletonTensors skeleton{torch::zeros({1, 3}), torch::tensor({-1})};
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
}  // namespace anigen::models
