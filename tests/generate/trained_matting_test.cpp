#include "anigen/generate/trained_matting.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/generate/picture_input.h"
#include "anigen/generate/run_weights.h"
#include "tests/generate/red_matting.h"
#include "tests/support/paths.h"

namespace anigen::generate {
namespace {

constexpr std::uint32_t kBlue = 0x0000C8FFU;

struct Box {
  int x = 0, y = 0, width = 0, height = 0;

  bool contains(int column, int row) const { return column >= x && column < x + width && row >= y && row < y + height; }
};

void paint_red(io::Image& picture, const Box& box) {
  for (int y = box.y; y < box.y + box.height; ++y) {
    for (int x = box.x; x < box.x + box.width; ++x) {
      const std::uint8_t red[] = {255, 0, 0, 255};
      std::copy(red, red + 4, picture.pixel(x, y));
    }
  }
}

class TrainedMattings : public ::testing::Test {
 protected:
  TrainedMattings() { test::write_red_matting(run()); }

  std::filesystem::path run() const { return folder_ / "matting"; }
  static void expect_error(const std::function<void()>& use, const std::string& words) {
    try {
      use();
      ADD_FAILURE() << "accepted; expected: " << words;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
    }
  }

  test::TemporaryFolder folder_;
};

TEST_F(TrainedMattings, DropASpeckAndKeepASecondPart) {
  // Of the network's size, so that no pixel is interpolated: 25 pixels are less than a fiftieth of 1440, 144 more.
  io::Image picture(64, 48, kBlue);
  paint_red(picture, {4, 4, 40, 36});
  paint_red(picture, {56, 40, 5, 5});
  paint_red(picture, {50, 10, 12, 12});
  const std::vector<std::uint8_t> mask = TrainedMatting(run()).mask(picture, "picture.png");
  ASSERT_EQ(mask.size(), 64U * 48U);
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 64; ++x) {
      const bool object = Box{4, 4, 40, 36}.contains(x, y) || Box{50, 10, 12, 12}.contains(x, y);
      EXPECT_EQ(mask[static_cast<std::size_t>(64 * y + x)], object ? 255 : 0) << x << ", " << y;
    }
  }
}

TEST_F(TrainedMattings, WorkOnPicturesOfAnyShape) {
  TrainedMatting matting(run());
  for (const auto& [width, height] : std::vector<std::pair<int, int>>{{200, 100}, {90, 300}, {20, 16}}) {
    io::Image picture(width, height, kBlue);
    const Box box{width / 10, height / 5, width / 2, height / 2};
    paint_red(picture, box);
    const std::vector<std::uint8_t> mask = matting.mask(picture, "picture.png");
    ASSERT_EQ(mask.size(), at(width * height));
    double both = 0.0, either = 0.0;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const bool found = mask[at(width * y + x)] >= 128, truth = box.contains(x, y);
        both += found && truth ? 1.0 : 0.0;
        either += found || truth ? 1.0 : 0.0;
      }
    }
    EXPECT_GT(both / either, 0.8) << width << " x " << height
                                  << ": up to a pixel of the network is lost along the edge";
  }
}

TEST_F(TrainedMattings, APictureWithoutAnObjectIsRefusedByName) {
  TrainedMatting matting(run());
  expect_error([&] { matting.mask(io::Image(64, 40, kBlue), "blue.png"); }, "blue.png: the matting network finds no");
  expect_error([&] { TrainedMatting{folder_.path()}; }, folder_.path().string());
}

TEST_F(TrainedMattings, ImagePreprocessorTakesARun) {
  InputPicture picture{io::Image(200, 100, kBlue), "picture.png", false};
  paint_red(picture.image, {60, 20, 60, 60});
  PreprocessingOptions options;
  options.size = 48;
  options.matting.network = run();
  const PreprocessedImage found = ImagePreprocessor(options).run(picture);
  EXPECT_NE(std::find(found.notices.begin(), found.notices.end(), "background: removed by the trained network matting"),
            found.notices.end());
  EXPECT_GT(found.picture.pixel(24, 24)[0], 240);
  EXPECT_EQ(found.picture.pixel(0, 0)[2], 0) << "the background is gone";
  options.matting.mean = {0.5, 0.5, 0.5};
  expect_error([&] { ImagePreprocessor{options}; }, "neither a mean nor a deviation");
  options = {};
  options.background = Background::kNetwork;
  options.matting.network = folder_.path();
  expect_error([&] { ImagePreprocessor{options}; }, folder_.path().string());
}

TEST_F(TrainedMattings, ShippedWeightsHaveOneOrNot) {
  ::setenv("ANIGEN_WEIGHTS", folder_.path().c_str(), 1);
  EXPECT_EQ(shipped_matting().string(), run().string());
  std::filesystem::remove_all(run());
  EXPECT_TRUE(shipped_matting().empty());
  ::setenv("ANIGEN_WEIGHTS", (folder_ / "missing").c_str(), 1);
  EXPECT_THROW(shipped_matting(), InputError);
  ::unsetenv("ANIGEN_WEIGHTS");
}

TEST_F(TrainedMattings, TheirWeightsCanBeInspected) {
  const Json found = describe_weights(run())["matting"];
  EXPECT_EQ(found["class"], vision::kMattingUNetClass);
  EXPECT_TRUE(found["complete"].get<bool>()) << found.dump();
}

}  // namespace
}  // namespace anigen::generate
