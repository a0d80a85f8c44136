#include "anigen/nn/fourier_embedding.h"

#include <gtest/gtest.h>

#include <cmath>

namespace anigen::nn {
namespace {

TEST(FourierEmbedding, BandsEndAtTheCountAndAreNotIntegerPowers) {
  // reference autoencoders.md, 0.2; a relative 1e-6 allows the few ulp between platforms
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
