// Fourier features of continuous coordinates.
#include "anigen/nn/embeddings.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

void run_freq_pos_embed(Fixture& fixture) {
  const Json& config = fixture.config();
  nn::FourierEmbedding::Options options;
  options.num_freqs = config.at("num_freqs");
  options.max_freq_log2 = config.at("max_freq_log2");
  const nn::FourierEmbedding logarithmic(options);
  fixture.check("freqs", logarithmic.bands());
  fixture.check("y3", logarithmic(fixture.input("x3")));
  fixture.check("y4", logarithmic(fixture.input("x4")));

  options.num_freqs = config.at("lin_num_freqs");
  options.max_freq_log2 = config.at("lin_max_freq_log2");
  options.log_sampling = false;
  options.include_input = false;
  fixture.check("y_lin", nn::FourierEmbedding(options)(fixture.input("x3")));
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(ops_dense_freq_pos_embed, anigen::test::run_freq_pos_embed)
