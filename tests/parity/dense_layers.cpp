// Norms, layouts and embeddings of the dense models.
#include "anigen/core/error.h"
#include "anigen/nn/embeddings.h"
#include "anigen/nn/init.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/volumes.h"
#include "tests/parity/parts.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

std::int64_t size_of(const Json& config, const char* key) { return config.at(key).get<std::int64_t>(); }

void run_norms(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const Json& config = fixture.config();
  const Tensor x = fixture.input("x"), volume = fixture.input("vol");
  const double eps = config.at("eps");

  nn::AffineLayerNorm affine(size_of(config, "channels"), eps);
  load_part(affine, fixture, "layernorm");
  fixture.check("layernorm", affine->forward(x));
  fixture.check("fp16_layernorm", affine->forward(x.to(torch::kHalf)).to(torch::kFloat32));
  fixture.check("layernorm_plain", nn::layer_norm(x, eps));

  nn::VolumeNorm group(size_of(config, "vol_channels"), nn::VolumeNormImpl::Kind::kGroup,
                       size_of(config, "num_groups"));
  load_part(group, fixture, "groupnorm");
  fixture.check("groupnorm", group->forward(volume));
  nn::VolumeNorm layer(size_of(config, "vol_channels"));
  load_part(layer, fixture, "channel_layernorm");
  fixture.check("channel_layernorm", layer->forward(volume));

  nn::MultiHeadRmsNorm rms(size_of(config, "dim"), size_of(config, "heads"));
  load_part(rms, fixture, "rms");
  fixture.check("rms", rms->forward(fixture.input("heads")));

  nn::Lora lora;
  lora.rank = size_of(config, "rank");
  lora.scale = config.at("lr_rate");
  nn::Linear linear(size_of(config, "channels"), size_of(config, "out_features"), true, lora);
  load_part(linear, fixture, "lora");
  fixture.check("lora", linear->forward(x));
}

void run_spatial(Fixture& fixture) {
  const std::int64_t patch = size_of(fixture.config(), "patch_size");
  fixture.check("shuffle", nn::pixel_shuffle_3d(fixture.input("x_shuffle"), size_of(fixture.config(), "scale_factor")));
  const Tensor patches = nn::patchify(fixture.input("x"), patch);
  fixture.check("patch", patches);
  fixture.check("unpatch", nn::unpatchify(patches, patch));
}

void run_absolute_position(Fixture& fixture) {
  const std::int64_t channels = size_of(fixture.config(), "channels");
  fixture.check("int", nn::absolute_position_embedding(fixture.input("pos"), channels));
  fixture.check("float", nn::absolute_position_embedding(fixture.input("pos_float"), channels));
  const Tensor cells = nn::grid_coordinates(size_of(fixture.config(), "grid_resolution"));
  fixture.check("grid", nn::absolute_position_embedding(cells, channels));
}

nn::TimestepEmbedder embedder_of(const Fixture& fixture, std::int64_t channels, std::int64_t width) {
  nn::TimestepEmbedder embedder(channels, width);
  load_whole(embedder, fixture);
  return embedder;
}

void run_timestep_embedder(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const Json& config = fixture.config();
  fixture.check_true("the published longest period", config.at("max_period") == 10000);
  const std::int64_t width = size_of(config, "frequency_embedding_size");
  const Tensor t = fixture.input("t");
  fixture.check("freq", nn::timestep_features(t, width));
  fixture.check("freq_odd", nn::timestep_features(t, size_of(config, "odd_dim")));
  fixture.check("y", embedder_of(fixture, size_of(config, "hidden_size"), width)->forward(t));
}

void run_embed(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const Json& config = fixture.config();
  fixture.check("ape", nn::absolute_position_embedding(fixture.input("coords"), size_of(config, "ape_channels")));
  for (std::size_t i = 0; i < config.at("fourier").size(); ++i) {
    const Json& entry = config.at("fourier").at(i);
    nn::FourierEmbedding::Options options;
    options.num_freqs = size_of(entry, "num_freqs");
    options.max_freq_log2 = entry.at("max_freq_log2");
    const nn::FourierEmbedding embedding(options);
    const std::string number = "." + std::to_string(i);
    fixture.check("fourier_freqs" + number, embedding.bands());
    fixture.check("fourier" + number, embedding(fixture.input("pos" + std::to_string(size_of(entry, "in_dim")))));
  }

  const std::int64_t width = size_of(config, "timestep_dim"), patch = size_of(config, "patch");
  fixture.check("t_freq", nn::timestep_features(fixture.input("t"), width));
  fixture.check("t_emb", embedder_of(fixture, size_of(config, "hidden"), width)->forward(fixture.input("t")));

  const Tensor dense = fixture.input("dense"), patches = nn::patchify(dense, patch);
  fixture.check("pixel_shuffle", nn::pixel_shuffle_3d(fixture.input("vol"), 2));  // by 2, the fixture says
  fixture.check("patchify", patches);
  fixture.check("unpatchify", nn::unpatchify(patches, patch));
  nn::VolumeNorm norm(dense.size(1));
  nn::default_norms(*norm);
  norm->to(fixture.device());
  fixture.check("chan_ln", norm->forward(dense));
}

// The rotary embedding cannot run in the published models either; these are the words of SparseStructureFlowOptions.
void run_rope(Fixture& fixture) {
  throw NotSupportedError(fixture.name() + ".json", "/config", "pe_mode 'rope'; use 'ape'");
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(ops_dense_norms, anigen::test::run_norms)
ANIGEN_DEVICE_PARITY(ops_dense_spatial, anigen::test::run_spatial)
ANIGEN_DEVICE_PARITY(ops_dense_abs_pos_embed, anigen::test::run_absolute_position)
ANIGEN_DEVICE_PARITY(ops_dense_timestep_embedder, anigen::test::run_timestep_embedder)
ANIGEN_DEVICE_PARITY(ops_embed, anigen::test::run_embed)
ANIGEN_PARITY(ops_dense_rope, anigen::test::run_rope)
