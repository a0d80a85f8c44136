#include "anigen/vision/patch_encoder.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"

namespace anigen::vision {
namespace {

PatchImageEncoderOptions small_options(std::int64_t blocks) {
  PatchImageEncoderOptions options;
  options.image_size = 12;
  options.patch_size = 4;
  options.width = 16;
  options.num_blocks = blocks;
  options.num_heads = 2;
  return options;
}

TEST(PatchImageEncoder, TokensAreThePatchesRowByRow) {
  torch::manual_seed(1);
  PatchImageEncoder encoder(small_options(0), 10);  // without blocks a token knows its own patch only
  const Tensor images = torch::rand({2, 3, 12, 12});
  const Tensor before = encoder->forward(images);
  ASSERT_EQ(before.sizes(), (std::vector<std::int64_t>{2, 9, 10}));
  Tensor changed = images.clone();
  changed[1][2][5][11].add_(0.5);  // row 1, column 2 of the patches
  const Tensor difference = (encoder->forward(changed) - before).abs().amax(-1);
  for (std::int64_t token = 0; token < 9; ++token) {
    EXPECT_EQ(difference[1][token].item<float>() > 1e-4f, token == 5) << token;
    EXPECT_EQ(difference[0][token].item<float>(), 0.0f);
  }
}

TEST(PatchImageEncoder, PlacesAreTold) {
  torch::manual_seed(1);
  PatchImageEncoder encoder(small_options(0), 10);
  const Tensor tokens = encoder->forward(torch::full({1, 3, 12, 12}, 0.3))[0];
  for (std::int64_t a = 0; a < 9; ++a) {
    for (std::int64_t b = 0; b < a; ++b)
      EXPECT_GT((tokens[a] - tokens[b]).abs().max().item<float>(), 1e-4f) << a << " and " << b;
  }
}

TEST(PatchImageEncoder, BlocksLetTokensSeeEachOtherButNotOtherPictures) {
  torch::manual_seed(1);
  PatchImageEncoder encoder(small_options(2), 10);
  const Tensor images = torch::rand({2, 3, 12, 12});
  const Tensor before = encoder->forward(images);
  Tensor changed = images.clone();
  changed[0][0][0][0].add_(0.5);
  const Tensor difference = (encoder->forward(changed) - before).abs().amax(-1);
  EXPECT_TRUE((difference[0] > 0).all().item<bool>());
  EXPECT_LT(difference[1].max().item<float>(), 1e-6f);
  // A condition has unit variance, so that it differs from the zeros of no picture.
  EXPECT_NEAR(before.square().mean().item<float>(), 1.0f, 1e-2f);
}

TEST(PatchImageEncoder, ConvolutionsHalveDownToTheSameTokens) {
  torch::manual_seed(1);
  PatchImageEncoderOptions options = small_options(0);
  options.convolutions = true;
  PatchImageEncoder encoder(options, 10);
  const Tensor images = torch::rand({2, 3, 12, 12});
  const Tensor before = encoder->forward(images);
  ASSERT_EQ(before.sizes(), (std::vector<std::int64_t>{2, 9, 10}));
  Tensor changed = images.clone();
  changed[1][2][5][11].add_(0.5);
  const Tensor difference = (encoder->forward(changed) - before).abs().amax(-1);
  EXPECT_GT(difference[1][5].item<float>(), 1e-4f);
  EXPECT_EQ(difference[0].max().item<float>(), 0.0f);
  before.square().sum().backward();
  for (const auto& parameter : encoder->named_parameters()) EXPECT_TRUE(parameter.value().grad().defined());
  EXPECT_EQ(PatchImageEncoderOptions::from_json(options.to_json()).to_json(), options.to_json());
  EXPECT_THROW(PatchImageEncoderOptions::from_json({{"image_size", 112}, {"patch_size", 14}, {"stem", "convolutions"}}),
               InputError);
  EXPECT_THROW(PatchImageEncoderOptions::from_json({{"stem", "pooling"}}), InputError);
}

TEST(PatchImageEncoder, RefusesWhatDoesNotFit) {
  PatchImageEncoder encoder(small_options(0), 10);
  EXPECT_THROW(encoder->forward(torch::rand({1, 3, 16, 16})), InputError);
  EXPECT_THROW(PatchImageEncoderOptions::from_json({{"image_size", 10}, {"patch_size", 4}}), InputError);
  EXPECT_THROW(PatchImageEncoderOptions::from_json({{"width", 10}, {"num_heads", 4}}), InputError);
  EXPECT_THROW(PatchImageEncoderOptions::from_json({{"blocks", 1}}), InputError);
  const PatchImageEncoderOptions options = small_options(3);
  EXPECT_EQ(PatchImageEncoderOptions::from_json(options.to_json()).to_json(), options.to_json());
}

}  // namespace
}  // namespace anigen::vision
