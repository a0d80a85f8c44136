#include <gtest/gtest.h>
#include <algorithm>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/vision/condition.h"
#include "anigen/vision/patch_encoder.h"
#include "tests/support/paths.h"
#include "tests/vision/deterministic_fill.h"

namespace anigen::vision {

namespace {

namespace fs = std::filesystem;

/// Published weights are looked for below the working directory.
class PublishedConditions : public testing::Test {
 protected:
  PublishedConditions() : before_(fs::current_path()) { fs::current_path(folder_.path()); }
  ~PublishedConditions() override { fs::current_path(before_); }

  static std::string message(const Json& args, std::int64_t channels = 384) {
    ConfigReader reader(args, "config.json", "/trainer/args");
    try {
      make_condition_encoder(reader, 518, channels, torch::kCPU);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }

  test::TemporaryFolder folder_;
  fs::path before_;
};

TEST_F(PublishedConditions, AreTakenFromTheirPublishedPlace) {
  const Json args = {{"image_cond_model", "dinov2_vits14_reg"}};
  const std::string missing = message(args);
  for (const char* part : {"/trainer/args/image_encoder", "ckpts/dinov2/dinov2_vits14_reg4_pretrain.pth", "patch"})
    EXPECT_NE(missing.find(part), std::string::npos) << missing;
  // A file that is no archive of weights: its error shows that it was read.
  write_file_atomically("ckpts/dinov2/dinov2_vits14_reg4_pretrain.safetensors", "damaged");
  EXPECT_NE(message(args).find("dinov2_vits14_reg4_pretrain.safetensors"), std::string::npos) << message(args);
  write_file_atomically("ckpts/dinov2/dinov2_vits14_reg4_pretrain.pth", "damaged");
  EXPECT_NE(message(args).find("dinov2_vits14_reg4_pretrain.pth"), std::string::npos) << message(args);
  EXPECT_NE(message(args, 1024).find("image_cond_model"), std::string::npos) << "a width that does not fit";
  EXPECT_NE(message(Json::object()).find("dinov2_vitl14_reg4_pretrain.pth"), std::string::npos);
}

}  // namespace

namespace {

/// A trained flow's run, as far as its image encoder is concerned.
void write_flow(const fs::path& run, const Json& encoder, std::int64_t channels) {
  const Json model = channels > 0 ? Json{{"args", {{"cond_channels", channels}}}} : Json{{"args", Json::object()}};
  const Json config = {{"models", {{"denoiser", model}}}, {"trainer", {{"args", {{"image_encoder", encoder}}}}}};
  write_file_atomically(run / "config.json", config.dump());
  PatchImageEncoder trained(PatchImageEncoderOptions::from_json(encoder), std::max<std::int64_t>(channels, 4));
  fs::create_directories(run / "ckpts");
  io::write_safetensors(run / "ckpts" / "image_encoder_step0000001.safetensors", nn::state_dict(*trained));
}

TEST(TokensOfAnotherFlow, FollowThoseOfTheEncoder) {
  const test::TemporaryFolder folder;
  const Json small = {{"name", "patch"}, {"image_size", 16}, {"patch_size", 8},
                      {"width", 8},      {"num_blocks", 1},  {"num_heads", 2}};
  write_flow(folder / "cheap", small, 12);
  Json encoder = small;
  encoder["flow"] = "cheap";
  const Json args = {{"image_encoder", encoder}};
  ConfigReader reader(args, "config.json", "/trainer/args");
  const auto made = make_condition_encoder(reader, 16, 20, torch::kCPU, folder.path() / "dear");
  const Tensor tokens = made->tokens(torch::rand({3, 3, 16, 16}));
  EXPECT_EQ(tokens.sizes(), (std::vector<std::int64_t>{3, 4 + 4, 20}));
  ASSERT_TRUE(made->trained());
  const auto trained = made->trained()->module->named_parameters();
  EXPECT_EQ(trained["flow_layer.weight"].sizes(), (std::vector<std::int64_t>{20, 12}));
  for (const auto& entry : trained) EXPECT_EQ(entry.key().find("cheap"), std::string::npos);
  // The other encoder is frozen: gradients reach the map of its tokens alone.
  tokens.slice(1, 4).square().sum().backward();
  EXPECT_TRUE(trained["flow_layer.weight"].grad().defined());
  EXPECT_EQ(trained["out_layer.weight"].grad().abs().max().item<float>(), 0.0F);
  const auto twin = made->replica();
  const torch::NoGradGuard no_grad;
  const Tensor images = torch::rand({1, 3, 16, 16});
  EXPECT_TRUE(torch::equal(twin->tokens(images), made->tokens(images)));
}

TEST(TokensOfAnotherFlow, ThatHasNoneAreAnErrorThatNamesItsConfig) {
  const test::TemporaryFolder folder;
  Json encoder = {{"name", "patch"}, {"image_size", 16}, {"patch_size", 8},
                  {"width", 8},      {"num_blocks", 1},  {"num_heads", 2}};
  write_flow(folder / "none", encoder, 0);
  encoder["flow"] = "none";
  const auto message = [&] {
    const Json args = {{"image_encoder", encoder}};
    ConfigReader reader(args, "config.json", "/trainer/args");
    try {
      make_condition_encoder(reader, 16, 20, torch::kCPU, folder.path() / "dear");
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  EXPECT_NE(message().find("no model of it has cond_channels"), std::string::npos) << message();
  const Json nested = {{"trainer", {{"args", {{"image_encoder", encoder}}}}}};
  write_file_atomically(folder / "nested" / "config.json", nested.dump());
  encoder["flow"] = "nested";
  EXPECT_NE(message().find("sees another flow's tokens itself"), std::string::npos) << message();
  encoder["flow"] = "nowhere";
  EXPECT_NE(message().find("/trainer/args/image_encoder/flow"), std::string::npos) << message();
}

/// A transparent picture with a coloured block at columns 10 … 19, rows 20 … 29.
io::Image block(std::uint8_t alpha) {
  io::Image image(60, 50, 0xFFFFFF00u);
  for (int y = 20; y < 30; ++y) {
    for (int x = 10; x < 20; ++x) {
      std::uint8_t* p = image.pixel(x, y);
      p[0] = 200;
      p[1] = 100;
      p[2] = 0;
      p[3] = alpha;
    }
  }
  return image;
}

TEST(ConditionImage, CropsToTheObjectOnBlack) {
  const Tensor image = condition_image(block(128), 36);
  ASSERT_EQ(image.sizes(), (std::vector<std::int64_t>{3, 36, 36}));
  // The block's extent is 9, so the crop is 10 or 11 wide and the block fills all but a border.
  EXPECT_NEAR(image[0][18][18].item<double>(), 200.0 / 255.0 * 128.0 / 255.0, 2e-3);
  EXPECT_NEAR(image[2].max().item<double>(), 0.0, 1e-6);
  // Nothing of the white that lies under alpha 0.
  EXPECT_LT(
      (image[1] / image[0].clamp_min(1e-3) - 0.5).where(image[0] > 0.2, torch::zeros({})).abs().max().item<double>(),
      0.02);
}

TEST(ConditionImage, WithoutAnyAlphaIsAnErrorThatNamesThePicture) {
  try {
    condition_image(block(0), 36, "renders_cond/x/000.png");
    FAIL() << "no error";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("renders_cond/x/000.png"), std::string::npos);
  }
}

TEST(InferenceImage, IsOpaqueAndQuantised) {
  const io::Image image = inference_image(block(255), 36);
  ASSERT_EQ(image.width, 36);
  ASSERT_EQ(image.height, 36);
  EXPECT_EQ(image.pixel(18, 18)[0], 200);
  EXPECT_EQ(image.pixel(18, 18)[3], 255);
  // Without foreground the whole picture is taken, which here is nothing but black.
  EXPECT_EQ(inference_image(block(0), 36).pixel(3, 3)[0], 0);
}

TEST(ViewImage, TakesTheWholePicture) {
  const Tensor image = view_image(block(255), 30);
  EXPECT_NEAR(image[0][15][7].item<double>(), 200.0 / 255.0, 2e-2);
  EXPECT_EQ(image[0][2][28].item<double>(), 0.0);
}

TEST(ImageCondition, AllTokensNormalisedWithoutParameters) {
  Dinov2Options options;
  options.img_size = 12;
  options.patch_size = 4;
  options.embed_dim = 8;
  options.depth = 2;
  options.num_heads = 2;
  options.num_register_tokens = 2;
  Dinov2 model(options);
  test::golden_fill(*model);
  const Tensor images = torch::rand({2, 3, 12, 12});
  const Tensor condition = image_condition(model, images);
  ASSERT_EQ(condition.sizes(), (std::vector<std::int64_t>{2, 1 + 2 + 9, 8}));
  EXPECT_FALSE(condition.requires_grad());
  const torch::NoGradGuard no_grad;
  const Tensor x = model->forward(imagenet_normalized(images)).x_prenorm;
  const Tensor centered = x - x.mean(-1, true);
  EXPECT_TRUE(torch::allclose(condition, centered / (centered.square().mean(-1, true) + 1e-5).sqrt(), 1e-4, 1e-5));
  const Tensor none = null_condition(condition);
  EXPECT_EQ(none.sizes(), condition.sizes());
  EXPECT_EQ(none.abs().max().item<float>(), 0.0F);
}

}  // namespace

}  // namespace anigen::vision
