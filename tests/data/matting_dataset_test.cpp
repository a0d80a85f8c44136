#include "anigen/data/matting_dataset.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>

#include "anigen/core/error.h"
#include "tests/data/disc_dataset.h"
#include "tests/support/paths.h"

namespace anigen::data {
namespace {

namespace fs = std::filesystem;

constexpr int kSide = 48;

TEST(PlacedObjects, LieAtTheirPlaceAndAreMirrored) {
  io::Image cutout(20, 10, 0x6496C8FFU);
  for (int y = 0; y < 10; ++y) cutout.pixel(0, y)[3] = 51;  // a fifth, on the left
  const PlacedObject object = place_object(cutout, 40, 0.5, 0.5, 0.5, false);
  ASSERT_EQ(object.alpha.size(), 1600U);
  ASSERT_EQ(object.color.size(), 4800U);
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 40; ++x) {
      const bool inside = x >= 10 && x < 30 && y >= 15 && y < 25;
      const float alpha = !inside ? 0.0F : x == 10 ? 51 / 255.0F : 1.0F;
      const auto i = static_cast<std::size_t>(40 * y + x);
      EXPECT_FLOAT_EQ(object.alpha[i], alpha) << x << ", " << y;
      EXPECT_FLOAT_EQ(object.color[1600 + i], alpha * (0x96 / 255.0F)) << x << ", " << y;
    }
  }
  const PlacedObject mirrored = place_object(cutout, 40, 0.5, 0.25, 0.5, true);  // left of the middle, then right of it
  EXPECT_FLOAT_EQ(mirrored.alpha[40 * 20 + 39], 51 / 255.0F);
  EXPECT_FLOAT_EQ(mirrored.alpha[40 * 20 + 38], 1.0F);
  EXPECT_FLOAT_EQ(mirrored.alpha[40 * 20 + 20], 1.0F);
  EXPECT_FLOAT_EQ(mirrored.alpha[40 * 20 + 19], 0.0F);
}

TEST(PlacedObjects, AreBlendedByTheirAlpha) {
  const PlacedObject object{{0.2F, 0.0F, 0.1F, 0.9F, 0.05F, 1.0F}, {0.25F, 1.0F}};  // color is multiplied by alpha
  const std::vector<float> background{0.8F, 0.8F, 0.4F, 0.4F, 0.0F, 0.0F};
  const std::vector<float> image = before_background(object, background);
  const std::vector<float> expected{0.2F + 0.6F, 0.0F, 0.1F + 0.3F, 0.9F, 0.05F, 1.0F};
  for (std::size_t i = 0; i < image.size(); ++i) EXPECT_FLOAT_EQ(image[i], expected[i]) << i;
}

class Mattings : public ::testing::Test {
 protected:
  Mattings() { test::write_disc_dataset(data(), 3); }

  fs::path data() const { return folder_ / "data"; }
  fs::path with_picture(const std::string& name, const io::Image& picture) const {
    fs::create_directories(folder_ / name);
    io::write_png(folder_ / name / "picture.png", picture);
    return folder_ / name;
  }

  Datasets made(Json args, std::uint64_t seed = 1) const {
    args["data_dir"] = data().string();
    args["image_size"] = kSide;
    const Json dataset = {{"name", "AniGenMattings"}, {"args", args}};
    return make_datasets(ConfigReader(dataset, "config.json", "/dataset"), seed);
  }
  static std::unique_ptr<MattingBatch> batch(const Datasets& data, const std::vector<Draw>& draws) {
    std::unique_ptr<Batch> loaded = data.train->load(draws);
    return std::unique_ptr<MattingBatch>(dynamic_cast<MattingBatch*>(loaded.release()));
  }
  void expect_refused(const Json& args, const std::string& words) const {
    try {
      made(args);
      ADD_FAILURE() << "accepted; expected: " << words;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
    }
  }

  test::TemporaryFolder folder_;
};

Json unchanged() { return {{"jitter", 0}, {"shadow", 0}, {"blur", 0}, {"noise", 0}, {"jpeg", 0}}; }

TEST_F(Mattings, ThePictureIsTheObjectBeforeTheBackground) {
  Json args = unchanged();
  args["backgrounds"] = with_picture("wall", io::Image(60, 90, 0x14508CFFU)).string();
  args["background_share"] = 1.0;
  const Datasets data = made(args);
  const torch::Tensor wall = torch::tensor({0x14, 0x50, 0x8C}, torch::kFloat32).div(255.0).view({3, 1, 1});
  const torch::Tensor red = torch::tensor({0xC8, 0x32, 0x32}, torch::kFloat32).div(255.0).view({3, 1, 1});
  for (std::uint64_t position = 0; position < 20; ++position) {
    const auto sample = batch(data, {{0, position}});
    ASSERT_EQ(sample->image.sizes(), (std::vector<std::int64_t>{1, 3, kSide, kSide}));
    ASSERT_EQ(sample->alpha.sizes(), (std::vector<std::int64_t>{1, 1, kSide, kSide}));
    const torch::Tensor alpha = sample->alpha[0];
    const torch::Tensor expected = alpha * red + (1.0 - alpha) * wall;
    const torch::Tensor away = (sample->image[0] - expected).abs();
    // Resampling by Lanczos overshoots inside the rim, by up to a tenth.
    EXPECT_LT(away.max().item<float>(), 0.1F) << position;
    EXPECT_LT(away.mean().item<float>(), 0.01F) << position;
    EXPECT_LT((away * (alpha == 0.0)).max().item<float>(), 1e-3F) << "the background alone";
    // A disc of half to 1.1 of the side, of which a tenth or so may lie outside.
    const double share = alpha.mean().item<double>();
    EXPECT_GT(share, 0.78 * 0.25 * 0.6) << position;
    EXPECT_LT(share, 0.96) << position;
  }
}

TEST_F(Mattings, SamplesDependOnSeedAndPositionAlone) {
  const Datasets data = made(Json::object()), other = made(Json::object(), 2);
  const auto together = batch(data, {{0, 3}, {1, 4}, {1, 5}}), alone = batch(data, {{1, 4}});
  EXPECT_TRUE(torch::equal(together->image[1], alone->image[0]));
  EXPECT_TRUE(torch::equal(together->alpha[1], alone->alpha[0]));
  EXPECT_FALSE(torch::equal(together->image[1], together->image[2]));
  EXPECT_FALSE(torch::equal(batch(other, {{1, 4}})->image, alone->image));
  EXPECT_TRUE(torch::equal(batch(made(Json::object()), {{1, 4}})->image, alone->image)) << "opened again";
  EXPECT_GE(together->image.min().item<float>(), 0.0F);
  EXPECT_LE(together->image.max().item<float>(), 1.0F);
}

TEST_F(Mattings, CutOutPicturesAreObjectsOfTrainingAlone) {
  Json args = unchanged();
  args["pictures"] = with_picture("cutouts", test::disc_cutout(80, 0xFF00FF)).string();
  args["picture_share"] = 1.0;
  args["eval_split"] = "splits/test.txt";
  const Datasets data = made(args);
  const auto magenta = [](const MattingBatch& sample) {
    const torch::Tensor inside = sample.alpha[0][0] > 0.999;
    return sample.image[0][1].masked_select(inside).mean().item<double>() < 0.02;
  };
  EXPECT_TRUE(magenta(*batch(data, {{0, 0}})));
  ASSERT_TRUE(data.eval);
  const auto held_out = data.eval->load({{0, 0}});
  EXPECT_FALSE(magenta(dynamic_cast<const MattingBatch&>(*held_out)));
  EXPECT_EQ(dynamic_cast<const MattingDataset&>(*data.eval).options().picture_share, 0.0);
}

TEST_F(Mattings, BadInputIsNamed) {
  fs::create_directories(folder_ / "empty");
  expect_refused({{"pictures", (folder_ / "empty").string()}}, (folder_ / "empty").string() + ": holds no picture");
  const fs::path opaque = with_picture("opaque", io::Image(32, 32, 0x405060FFU));
  expect_refused({{"pictures", opaque.string()}}, (opaque / "picture.png").string() + ": has no transparent pixel");
  expect_refused({{"picture_share", 0.5}}, "/dataset/args/picture_share");
  expect_refused({{"background_share", 0.5}}, "/dataset/args/background_share");
  expect_refused({{"backgrounds", "nowhere"}}, "nowhere");
  expect_refused({{"jitter", -1}}, "jitter");
  fs::remove(data() / "renders_cond/disc1/transforms.json");
  expect_refused(Json::object(), "disc1");
}

TEST_F(Mattings, CreaturesThatAreKeptForTestingAreNotTrainedOn) {
  test::write_disc_dataset(data(), 3, "procedural/900000001/0");
  expect_refused(Json::object(), "900000001");
}

}  // namespace
}  // namespace anigen::data
