// Anymate's three encoders of point clouds.
#include "anigen/anymate/point_encoders.h"
#include "tests/parity/anymate_parts.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

void run_pointbert(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  anymate::PointBertOptions options;
  options.trans_dim = anymate_size(fixture, "trans_dim");
  options.depth = anymate_size(fixture, "depth");
  options.num_heads = anymate_size(fixture, "num_heads");
  options.group_size = anymate_size(fixture, "group_size");
  options.num_group = anymate_size(fixture, "num_group");
  options.encoder_dims = anymate_size(fixture, "encoder_dims");
  options.point_dims = anymate_size(fixture, "point_dims");
  options.drop_path_rate = fixture.config().at("drop_path_rate");
  anymate::PointBert encoder(options, nn::Init::kNone);
  load_part(encoder, fixture, "encoder");
  encoder->eval();
  const auto widths = fixture.config().at("proj").get<std::vector<std::int64_t>>();
  anymate::TokenProjection projection(
      anymate::ProjectionWidths{options.trans_dim, widths.at(0), widths.at(1), widths.at(2)});
  load_part(projection, fixture, "point_proj");

  const Tensor points = fixture.input("points_cloud"), start = fixture.input("fps_start");
  const anymate::PointGroups groups = encoder->grouped(points, start);
  fixture.check("centers", groups.centers);
  fixture.check("group_index", std::get<0>(groups.rows.sort(-1)));
  fixture.check("group_feat", encoder->group_features(groups));
  const Tensor tokens = encoder(points, start);
  fixture.check("tokens", tokens);
  fixture.check("latents", projection(tokens));
}

void run_michelangelo(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const Json& config = fixture.config();
  anymate::MichelangeloOptions options;
  options.num_latents = anymate_size(fixture, "num_latents");
  options.embed_dim = anymate_size(fixture, "embed_dim");
  options.point_feats = anymate_size(fixture, "point_feats");
  options.num_freqs = anymate_size(fixture, "num_freqs");
  options.include_pi = config.at("include_pi");
  options.width = anymate_size(fixture, "width");
  options.heads = anymate_size(fixture, "heads");
  options.num_encoder_layers = anymate_size(fixture, "num_encoder_layers");
  options.num_decoder_layers = anymate_size(fixture, "num_decoder_layers");
  options.use_ln_post = config.at("use_ln_post");
  options.qkv_bias = config.at("qkv_bias");
  anymate::MichelangeloEncoder encoder(options, nn::Init::kNone);
  load_all(encoder, fixture);
  const Tensor points = fixture.input("points_cloud"), noise = fixture.input("noise");
  const anymate::MichelangeloCode code = encoder->encode(points, noise);
  fixture.check("shape_embed", code.shape_embed);
  fixture.check("shape_latents", code.shape_latents);
  fixture.check("kl_mean", code.kl_mean);
  fixture.check("kl_logvar", code.kl_logvar);
  fixture.check("latents", code.latents);
  fixture.check("encoded", encoder(points, noise));

  options.only_embed = true;
  anymate::MichelangeloEncoder embedder(options, nn::Init::kNone);
  nn::load_state_dict(*embedder, fixture.parameters(), nn::LoadMode::kNonStrict);
  embedder->to(fixture.device());
  fixture.check("embed_only", embedder(points));
}

void run_transformer_encoder(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  anymate::ScratchEncoderOptions options;
  options.num_latents = anymate_size(fixture, "num_latents");
  options.width = anymate_size(fixture, "width");
  options.heads = anymate_size(fixture, "heads");
  options.num_encoder_layers = anymate_size(fixture, "num_encoder_layers");
  options.num_freqs = anymate_size(fixture, "num_freqs");
  anymate::ScratchEncoder encoder(options, nn::Init::kNone);
  load_part(encoder, fixture, "encoder");
  nn::Linear embed(options.width, options.width);
  load_part(embed, fixture, "points_cloud_embed");
  fixture.check("cond", embed(encoder(fixture.input("points_cloud"))));
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(ops_anymate_pointbert, anigen::test::run_pointbert)
ANIGEN_DEVICE_PARITY(ops_anymate_michelangelo_encoder, anigen::test::run_michelangelo)
ANIGEN_DEVICE_PARITY(ops_anymate_transformer_encoder, anigen::test::run_transformer_encoder)
