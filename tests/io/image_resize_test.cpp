#include "anigen/io/image_resize.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/random.h"

namespace anigen::io {
namespace {

Image noise(int width, int height, std::uint64_t seed) {
  Rng rng(seed, "picture");
  Image image(width, height);
  for (std::uint8_t& byte : image.rgba) byte = static_cast<std::uint8_t>(rng.index(256));
  return image;
}

TEST(ResizeLanczos, SameSizeIsUntouched) {
  const Image image = noise(9, 7, 1);  // with colours under alpha 0 that a premultiplied pass would lose
  EXPECT_EQ(resize_lanczos(image, 9, 7, ResizeAlpha::kPremultiplied).rgba, image.rgba);
}

TEST(ResizeLanczos, HalfOfTwoPixelsIsTheirRoundedMean) {
  Image image(2, 1);
  image.rgba = {0, 10, 255, 255, 255, 20, 0, 255};
  const Image found = resize_lanczos(image, 1, 1, ResizeAlpha::kPremultiplied);
  EXPECT_EQ(found.rgba, (std::vector<std::uint8_t>{128, 15, 128, 255}));
}

TEST(ResizeLanczos, KeepsConstantsAtEverySize) {
  const Image image(17, 5, 0x40A0F0FFu);
  for (const int width : {1, 4, 16, 18, 100}) {
    const Image found = resize_lanczos(image, width, 2 * width, ResizeAlpha::kSeparate);
    ASSERT_EQ(found.width, width);
    ASSERT_EQ(found.height, 2 * width);
    EXPECT_EQ(found.rgba, Image(width, 2 * width, 0x40A0F0FFu).rgba) << width;
  }
}

TEST(ResizeLanczos, OvershootAtAnEdgeIsClamped) {
  Image image(8, 1, 0x000000FFu);
  for (int x = 4; x < 8; ++x) image.pixel(x, 0)[0] = 255;
  const Image found = resize_lanczos(image, 64, 1, ResizeAlpha::kSeparate);
  // The lobes left and right of the edge would be negative and above 255.
  for (int x = 0; x < 28; ++x) EXPECT_LT(found.pixel(x, 0)[0], 30) << x;
  for (int x = 36; x < 64; ++x) EXPECT_GT(found.pixel(x, 0)[0], 225) << x;
  EXPECT_EQ(found.pixel(26, 0)[0], 0);
  EXPECT_EQ(found.pixel(37, 0)[0], 255);
}

TEST(ResizeLanczos, TransparentColoursBleedOnlyWhenChannelsAreSeparate) {
  Image image(8, 8, 0x00FF0000u);  // transparent green, and opaque red on the right half
  for (int y = 0; y < 8; ++y) {
    for (int x = 4; x < 8; ++x) {
      image.pixel(x, y)[0] = image.pixel(x, y)[3] = 255;
      image.pixel(x, y)[1] = 0;
    }
  }
  const Image premultiplied = resize_lanczos(image, 5, 5, ResizeAlpha::kPremultiplied);
  const Image separate = resize_lanczos(image, 5, 5, ResizeAlpha::kSeparate);
  for (int x = 0; x < 5; ++x) EXPECT_EQ(premultiplied.pixel(x, 2)[1], 0) << x;
  EXPECT_GT(separate.pixel(2, 2)[1], 60);
  EXPECT_GT(premultiplied.pixel(2, 2)[0], 240);
  EXPECT_EQ(premultiplied.pixel(2, 2)[3], separate.pixel(2, 2)[3]);
}

TEST(ResizeLanczos, AxesAreIndependent) {
  const Image image = noise(12, 10, 2);
  const Image once = resize_lanczos(image, 5, 21, ResizeAlpha::kSeparate);
  const Image twice =
      resize_lanczos(resize_lanczos(image, 5, 10, ResizeAlpha::kSeparate), 5, 21, ResizeAlpha::kSeparate);
  EXPECT_EQ(once.rgba, twice.rgba);
}

TEST(ResizeLanczos, RefusesBadSizes) {
  const Image image = noise(3, 3, 3);
  EXPECT_THROW(resize_lanczos(image, 0, 3, ResizeAlpha::kSeparate), InputError);
  EXPECT_THROW(resize_lanczos(image, 3, -1, ResizeAlpha::kSeparate), InputError);
  EXPECT_THROW(resize_lanczos(image, 16385, 3, ResizeAlpha::kSeparate), InputError);
  EXPECT_THROW(resize_lanczos(Image(), 3, 3, ResizeAlpha::kSeparate), InputError);
}

}  // namespace
}  // namespace anigen::io
