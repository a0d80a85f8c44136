#include "anigen/train/stages/autoencoder_stage.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"

namespace anigen::train {
namespace {

using torch::Tensor;

TEST(LatentDenoising, TheRampEndsAtTheGivenStep) {
  LatentDenoising noise;
  noise.time_max = 0.25;
  noise.ramp_steps = 10;
  EXPECT_EQ(noise.time_max_at(0), 0.0);
  EXPECT_DOUBLE_EQ(noise.time_max_at(5), 0.125);
  EXPECT_DOUBLE_EQ(noise.time_max_at(1000), 0.25);
  noise.ramp_steps = 0;
  EXPECT_DOUBLE_EQ(noise.time_max_at(0), 0.25);
}

TEST(LatentDenoising, DensityOfTheTimesFallsLinearly) {
  // With u in equal steps the share of times below t is 1 − (1 − t / most)².
  const Tensor u = (torch::arange(10000, torch::kFloat64) + 0.5) / 10000.0;
  const Tensor times = latent_times(u, 0.8);
  for (const double t : {0.1, 0.4, 0.7}) {
    const double share = (times < t).to(torch::kFloat64).mean().item<double>();
    EXPECT_NEAR(share, 1.0 - (1.0 - t / 0.8) * (1.0 - t / 0.8), 2e-4);
  }
  EXPECT_NEAR(latent_times(torch::ones({1}, torch::kFloat64), 0.8).item<double>(), 0.8 * (1.0 - 1e-4), 1e-12);
}

TEST(LatentDenoising, MixesEveryRowWithItsOwnTime) {
  const Tensor z = torch::ones({3, 2, 1, 1, 2}), noise = torch::full({3, 2, 1, 1, 2}, 10.0);
  const Tensor mixed = mix_latent_noise(z, noise, torch::tensor({0.0, 0.5, 1.0}), 2.0);
  for (const auto& [row, wanted] : {std::pair{0, 1.0}, {1, 10.5}, {2, 20.0}}) {
    EXPECT_TRUE(torch::allclose(mixed[row], torch::full({2, 1, 1, 2}, wanted)));
  }
  EXPECT_THROW(mix_latent_noise(z, noise, torch::zeros({2}), 1.0), InputError);
  EXPECT_THROW(mix_latent_noise(z, noise[0], torch::zeros({3}), 1.0), InputError);
}

TEST(LatentDenoising, ReadsThePublishedNames) {
  const Json json = Json::parse(R"({"latent_denoising_skl": true, "latent_denoising_gamma_skl": 0.5,
    "latent_time_max_skl": 0.25, "latent_achive_max_step_skl": 20})");
  ConfigReader reader(json, "config.json");
  ConfigFields fields(reader);
  LatentDenoising noise;
  noise.fields(fields, "_skl");
  reader.finish();
  EXPECT_TRUE(noise.enabled);
  EXPECT_EQ(noise.gamma, 0.5);
  EXPECT_EQ(noise.time_max, 0.25);
  EXPECT_EQ(noise.ramp_steps, 20);
}

}  // namespace
}  // namespace anigen::train
