#include "anigen/models/skin_autoencoder_init.h"

#include <gtest/gtest.h>

namespace anigen::models {
namespace {

// Standard deviation over joints of the logits (log weights up to a constant per row) a fresh model gives.
double logit_spread(bool unit_gain) {
  SkinAutoEncoderOptions options;
  options.encoder_config.jp_embed_dim = 64;
  options.encoder_config.jp_embedder_config.hidden_dim = 64;
  options.encoder_config.skin_feat_channels = 4;
  options.decoder_config.skin_feat_channels = 4;
  options.decoder_config.model_channels = 32;
  double sum = 0.0;
  constexpr int kModels = 8;
  for (int seed = 0; seed < kModels; ++seed) {
    torch::manual_seed(seed);
    SkinAutoEncoder model(options);
    if (unit_gain) rescale_to_unit_gain(model);
    const torch::NoGradGuard no_grad;
    const torch::Tensor joints = torch::rand({12, 3}) - 0.5;
    torch::Tensor parents = torch::arange(-1, 11);
    const SkeletonBatch skeletons = SkeletonBatch::from_lists({joints}, {parents});
    const torch::Tensor skin = torch::softmax(6.0 * torch::randn({50, 12}), 1);
    sum += model->reconstruct_log(skeletons, {skin}).front().std(1).mean().item<double>();
  }
  return sum / kModels;
}

TEST(UnitGain, LogitsBeginAlive) {
  EXPECT_LT(logit_spread(false), 0.02);  // the published start: all joints alike
  const double spread = logit_spread(true);
  EXPECT_GT(spread, 0.3);
  EXPECT_LT(spread, 6.0);
}

}  // namespace
}  // namespace anigen::models
