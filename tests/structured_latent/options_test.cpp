#include "anigen/structured_latent/options.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "tests/structured_latent/small_structured_latents.h"

namespace anigen::structured_latent {
namespace {

template <typename Options>
std::string slat_refusal(Json json, const char* key, const Json& value) {
  json[key] = value;
  try {
    Options::from_json(json, "config.json", "/models/coder/args");
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST(StructuredLatentOptions, JsonRoundTripKeepsEverything) {
  Json encoder = StructuredLatentEncoderOptions::from_json(test::small_slat_encoder_json()).to_json();
  encoder["encode_upsampled_skin_feat"] = false;
  encoder["latent_denoising"] = false;
  encoder["num_heads"] = nullptr;
  encoder["num_head_channels"] = 6;
  encoder["skin_ae_name"] = "Other";
  EXPECT_EQ(StructuredLatentEncoderOptions::from_json(encoder).to_json(), encoder);
  EXPECT_EQ(StructuredLatentEncoderOptions::from_json(encoder).heads(), 2);
  Json decoder = StructuredLatentDecoderOptions::from_json(test::small_slat_decoder_json()).to_json();
  decoder["grouping_strategy"] = "threshold";
  decoder["vertex_skin_feat_interp_nearest"] = true;
  decoder["flexicube_disable_deform"] = true;
  decoder["use_checkpoint"] = true;
  EXPECT_EQ(StructuredLatentDecoderOptions::from_json(decoder).to_json(), decoder);
  const auto mesh = StructuredLatentDecoderOptions::from_json(decoder).mesh_options();
  EXPECT_TRUE(mesh.skin_interp_nearest && mesh.disable_deform && !mesh.skin_interp_sparse);
}

TEST(StructuredLatentOptions, DefaultsAreThoseOfTheTwoClasses) {
  const StructuredLatentEncoderOptions encoder;
  const StructuredLatentDecoderOptions decoder;
  EXPECT_TRUE(encoder.skin_cross_from_geo && encoder.skl_cross_from_geo && encoder.skin_skl_cross);
  EXPECT_FALSE(decoder.skin_cross_from_geo || decoder.skl_cross_from_geo || decoder.skin_skl_cross);
  EXPECT_TRUE(encoder.normalize_z && !encoder.jp_residual_fields && !encoder.jp_hyper_continuous);
  EXPECT_TRUE(!decoder.normalize_z && decoder.jp_residual_fields && decoder.jp_hyper_continuous);
  EXPECT_EQ(decoder.h_skin_unet_num_levels, 4);
  EXPECT_EQ(encoder.attn_mode_cross, "full");
}

TEST(StructuredLatentOptions, BadValuesNameTheKey) {
  const Json encoder = test::small_slat_encoder_json(), decoder = test::small_slat_decoder_json();
  const auto of_encoder = [&](const char* key, const Json& value) {
    return slat_refusal<StructuredLatentEncoderOptions>(encoder, key, value);
  };
  const auto of_decoder = [&](const char* key, const Json& value) {
    return slat_refusal<StructuredLatentDecoderOptions>(decoder, key, value);
  };
  const auto contains = [](const std::string& text, const char* part) { return text.find(part) != std::string::npos; };
  EXPECT_TRUE(contains(of_encoder("latent_channel", 3), "latent_channels"));
  EXPECT_TRUE(contains(of_encoder("num_heads", 5), "num_heads"));
  EXPECT_TRUE(contains(of_encoder("num_heads_skl", 3), "num_heads_skl"));
  EXPECT_TRUE(contains(of_encoder("attn_mode", "shift_order"), "not supported"));
  EXPECT_TRUE(contains(of_encoder("attn_mode_cross", "around"), "attn_mode_cross"));
  EXPECT_TRUE(contains(of_encoder("pe_mode", "rope"), "not supported"));
  EXPECT_TRUE(contains(of_encoder("normalize_scale", 0), "normalize_scale"));
  EXPECT_TRUE(contains(of_encoder("resolution", 1 << 20), "resolution"));
  EXPECT_TRUE(contains(of_encoder("skin_encoder_config", {{"jp_embed_dims", 8}}), "jp_embed_dim"));
  EXPECT_TRUE(contains(of_decoder("model_channels", 128), "model_channels"));
  EXPECT_TRUE(contains(of_decoder("model_channels_skin", 36), "32 groups"));
  EXPECT_TRUE(contains(of_decoder("representation_config", {{"use_colour", true}}), "use_color"));
  EXPECT_TRUE(contains(of_decoder("grouping_strategy", "k_means"), "mean_shift"));
  EXPECT_TRUE(contains(of_decoder("skin_decoder_config", {{"model_type", "mlp"}}), "not supported"));
  for (const char* key : {"resolution", "in_channels", "num_blocks", "latent_channels_vertskin"}) {
    Json without = encoder;
    without.erase(key);
    EXPECT_THROW(StructuredLatentEncoderOptions::from_json(without), InputError) << key;
  }
}

TEST(StructuredLatentOptions, ConfidenceChannels) {
  Json json = test::small_slat_decoder_json();
  json["representation_config"] = {{"use_conf_jp", false}, {"use_conf_skin", true}};
  StructuredLatentDecoderOptions options = StructuredLatentDecoderOptions::from_json(json);
  // A continuous field has the two confidences, and the joint's serves the skin.
  EXPECT_TRUE(options.has_joint_confidence() && !options.has_skin_confidence());
  options.jp_hyper_continuous = false;
  EXPECT_TRUE(!options.has_joint_confidence() && options.has_skin_confidence());
}

}  // namespace
}  // namespace anigen::structured_latent
