#include "anigen/vision/matting.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen::vision {
namespace {

MattingUNetOptions tiny_matting() {
  MattingUNetOptions options;
  options.image_size = 32;
  options.width = 64;
  options.num_blocks = 1;
  options.num_heads = 2;
  return options;
}

TEST(MattingUNets, GiveLogitsOfThePicturesSize) {
  torch::manual_seed(1);
  MattingUNet model(tiny_matting());
  const Tensor logits = model->forward(torch::rand({2, 3, 32, 32}));
  EXPECT_EQ(logits.sizes(), (std::vector<std::int64_t>{2, 1, 32, 32}));
  EXPECT_TRUE(logits.isfinite().all().item<bool>());
  logits.sum().backward();
  for (const auto& parameter : model->named_parameters())
    EXPECT_TRUE(parameter.value().grad().defined()) << parameter.key();
  for (const auto& shape : std::vector<std::vector<std::int64_t>>{{1, 3, 48, 48}, {1, 4, 32, 32}, {3, 32, 32}})
    EXPECT_THROW(model->forward(torch::zeros(shape)), InputError) << c10::str(shape);
}

TEST(MattingUNets, TheOneThatShipsIsSmall) {
  const Json config = read_json(test::source_dir() / "configs/small/matting.json");
  const MattingUNet model(MattingUNetOptions::from_json(config["models"]["matting"]["args"]));
  std::int64_t parameters = 0;
  for (const Tensor& parameter : model->parameters()) parameters += parameter.numel();
  EXPECT_LT(parameters, 1'000'000);
  EXPECT_GT(parameters, 500'000);
}

TEST(MattingUNetOptions, AreChecked) {
  const MattingUNetOptions options = tiny_matting();
  EXPECT_EQ(MattingUNetOptions::from_json(options.to_json()).to_json(), options.to_json());
  for (const auto& [key, value] :
       std::vector<std::pair<std::string, int>>{{"image_size", 40}, {"width", 96}, {"num_heads", 3}, {"families", 2}}) {
    Json json = options.to_json();
    json[key] = value;
    try {
      MattingUNetOptions::from_json(json, "config.json", "/args");
      ADD_FAILURE() << key;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(key), std::string::npos) << error.what();
    }
  }
}

// Discs and boxes of one colour before gradients and checks of others.
struct Shapes {
  Tensor images = torch::empty({4, 3, 32, 32}), alphas = torch::zeros({4, 1, 32, 32});

  Shapes() {
    const Tensor y = torch::arange(32, torch::kFloat32).view({32, 1}).expand({32, 32}), x = y.t();
    for (std::int64_t i = 0; i < 4; ++i) {
      const Tensor disc = (x - 12.0 - 2.0 * i).square() + (y - 15.0).square() < 64.0;
      const Tensor box = (x > 6.0 + i) & (x < 18.0 + i) & (y > 8.0) & (y < 24.0);
      const Tensor alpha = (i % 2 == 0 ? disc : box).to(torch::kFloat32);
      const Tensor texture = i < 2 ? x / 32.0 : ((x / 4.0).floor() + (y / 4.0).floor()).remainder(2.0);
      for (std::int64_t c = 0; c < 3; ++c) {
        const double color = c == i % 3 ? 0.9 : 0.2;
        images[i][c] = alpha * color + (1.0 - alpha) * (0.3 + 0.4 * texture);
      }
      alphas[i][0] = alpha;
    }
  }
};

TEST(MattingUNets, LearnAFewPicturesByHeart) {
  torch::manual_seed(2);
  const Shapes shapes;
  MattingUNet model(tiny_matting());
  torch::optim::Adam optimizer(model->parameters(), torch::optim::AdamOptions(3e-3));
  double iou = 0.0;
  for (int step = 0; step < 240 && iou < 0.95; ++step) {
    const Tensor logits = model->forward(shapes.images);
    const Tensor found = logits.detach() > 0.0, truth = shapes.alphas > 0.5;
    iou = (found & truth).sum().item<double>() / (found | truth).sum().item<double>();
    optimizer.zero_grad();
    torch::binary_cross_entropy_with_logits(logits, shapes.alphas).backward();
    optimizer.step();
  }
  EXPECT_GT(iou, 0.9);
}

}  // namespace
}  // namespace anigen::vision
