#include <gtest/gtest.h>
#include <cmath>
#include <string>
#include <vector>

#include "anigen/nn/embeddings.h"
#include "anigen/nn/volumes.h"

// Position and timestep embeddings, and the layouts of volumes.

namespace anigen::nn {

namespace {

TEST(AbsolutePosition, SinesThenCosinesPerAxisThenZeros) {
  // 17 channels for three axes: two frequencies each, 1 and 1/100, and five zeros.
  const Tensor row = absolute_position_embedding(torch::tensor({{3, 0, 50}}), 17)[0];
  const double wanted[12] = {std::sin(3.0), std::sin(0.03), std::cos(3.0), std::cos(0.03), 0.0,          0.0, 1.0,
                             1.0,           std::sin(50.0), std::sin(0.5), std::cos(50.0), std::cos(0.5)};
  ASSERT_EQ(row.numel(), 17);
  for (int i = 0; i < 12; ++i) EXPECT_NEAR(row[i].item<double>(), wanted[i], 1e-5) << i;  // fp32 arguments up to 50
  EXPECT_EQ(row.slice(0, 12).abs().max().item<double>(), 0.0);
}

TEST(GridCoordinates, LastAxisFastest) {
  const Tensor cells = grid_coordinates(3);
  ASSERT_EQ(cells.sizes(), (std::vector<std::int64_t>{27, 3}));
  for (std::int64_t i = 0; i < 27; ++i) {
    const Tensor wanted = torch::tensor({i / 9, i / 3 % 3, i % 3});
    EXPECT_TRUE(torch::equal(cells[i], wanted)) << i;
  }
}

TEST(TimestepFeatures, CosinesFirst) {
  const Tensor row = timestep_features(torch::tensor({250.0F}), 5)[0];
  const double wanted[5] = {std::cos(250.0), std::cos(2.5), std::sin(250.0), std::sin(2.5), 0.0};
  for (int i = 0; i < 5; ++i) EXPECT_NEAR(row[i].item<double>(), wanted[i], 5e-5) << i;  // fp32 arguments up to 250
}

TEST(TimestepEmbedder, KeysOfTheMlp) {
  TimestepEmbedder embedder(8, 6);
  std::vector<std::string> keys;
  for (const auto& entry : embedder->named_parameters()) keys.push_back(entry.key());
  EXPECT_EQ(keys, (std::vector<std::string>{"mlp.0.weight", "mlp.0.bias", "mlp.2.weight", "mlp.2.bias"}));
  EXPECT_EQ(embedder->first->weight.sizes(), (std::vector<std::int64_t>{8, 6}));
}

Tensor numbered(std::vector<std::int64_t> shape) {
  std::int64_t count = 1;
  for (const std::int64_t size : shape) count *= size;
  return torch::arange(count, torch::kFloat32).view(shape);
}

TEST(Patchify, OffsetsFollowTheChannel) {
  const Tensor volume = numbered({2, 3, 4, 6, 2}), patches = patchify(volume, 2);
  ASSERT_EQ(patches.sizes(), (std::vector<std::int64_t>{2, 24, 2, 3, 1}));
  for (std::int64_t channel = 0; channel < 24; ++channel) {
    const std::int64_t c = channel / 8, i = channel / 4 % 2, j = channel / 2 % 2, k = channel % 2;
    for (std::int64_t x = 0; x < 2; ++x) {
      for (std::int64_t y = 0; y < 3; ++y)
        EXPECT_EQ(patches[1][channel][x][y][0].item<float>(), volume[1][c][2 * x + i][2 * y + j][k].item<float>());
    }
  }
  EXPECT_TRUE(torch::equal(unpatchify(patches, 2), volume));
  EXPECT_TRUE(torch::equal(patchify(volume, 1), volume));
}

TEST(PixelShuffle, IsTheInverseOfPatchify) {
  const Tensor volume = numbered({1, 54, 2, 1, 3});
  EXPECT_TRUE(torch::equal(patchify(pixel_shuffle_3d(volume, 3), 3), volume));
}

TEST(VolumeLayout, RejectsSizesThatDoNotDivide) {
  EXPECT_THROW(patchify(numbered({1, 1, 3, 4, 4}), 2), c10::Error);
  EXPECT_THROW(pixel_shuffle_3d(numbered({1, 12, 2, 2, 2}), 2), c10::Error);
  EXPECT_THROW(patchify(numbered({1, 4, 4, 4}), 2), c10::Error);
}

}  // namespace

namespace {

TEST(FourierEmbedding, BandsEndAtTheCountAndAreNotIntegerPowers) {
  // docs/reference/autoencoders.md, 1.2; a relative 1e-6 allows the few ulp between platforms
  const double wanted[12] = {1,         2.13008213, 4.53725052, 9.66471672, 20.5866394, 43.8512344,
                             93.406723, 198.963989, 423.809753, 902.749573, 1922.93066, 4096};
  const Tensor bands = FourierEmbedding(12).bands();
  ASSERT_EQ(bands.numel(), 12);
  for (int k = 0; k < 12; ++k) EXPECT_NEAR(bands[k].item<double>(), wanted[k], 1e-6 * wanted[k]);
}

TEST(FourierEmbedding, RawInputFirstThenSinesAndCosinesPerBand) {
  const FourierEmbedding embedding(2);  // bands 1 and 4
  const Tensor x = torch::tensor({{0.25, -0.5}}, torch::kFloat64);
  const Tensor y = embedding(x);
  ASSERT_EQ(y.sizes(), (std::vector<std::int64_t>{1, embedding.width(2)}));
  const double wanted[10] = {0.25,          -0.5,          std::sin(0.25), std::sin(-0.5), std::cos(0.25),
                             std::cos(0.5), std::sin(1.0), std::sin(-2.0), std::cos(1.0),  std::cos(2.0)};
  for (int i = 0; i < 10; ++i) EXPECT_NEAR(y[0][i].item<double>(), wanted[i], 1e-12) << i;
}

}  // namespace

}  // namespace anigen::nn
