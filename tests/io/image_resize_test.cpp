#include <gtest/gtest.h>
#include <algorithm>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/io/image_resize.h"

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

namespace {

/// Transparent, with alpha at some pixels.
Image with_alpha(int width, int height, const std::vector<std::array<int, 3>>& pixels) {
  Image image(width, height, 0x10203000u);
  for (const auto& [x, y, alpha] : pixels) image.pixel(x, y)[3] = static_cast<std::uint8_t>(alpha);
  return image;
}

TEST(Crop, TakesThePartAndFillsOutsideWithTransparentBlack) {
  Image image(4, 3, 0x01020304u);
  image.pixel(3, 2)[0] = 99;
  const Image inside = crop(image, {2, 1, 4, 3});
  ASSERT_EQ(inside.width, 2);
  ASSERT_EQ(inside.height, 2);
  EXPECT_EQ(inside.pixel(1, 1)[0], 99);
  EXPECT_EQ(inside.pixel(0, 0)[2], 3);

  const Image beyond = crop(image, {-2, -1, 6, 5});
  ASSERT_EQ(beyond.width, 8);
  ASSERT_EQ(beyond.height, 6);
  EXPECT_EQ(beyond.pixel(5, 3)[0], 99);
  for (int c = 0; c < 4; ++c) {
    EXPECT_EQ(beyond.pixel(1, 3)[c], 0);
    EXPECT_EQ(beyond.pixel(6, 3)[c], 0);
    EXPECT_EQ(beyond.pixel(3, 0)[c], 0);
    EXPECT_EQ(beyond.pixel(3, 4)[c], 0);
    EXPECT_EQ(beyond.pixel(2, 1)[c], c + 1);
  }
  EXPECT_EQ(crop(image, {100, 100, 102, 103}).rgba, std::vector<std::uint8_t>(24, 0));
}

TEST(Crop, RefusesEmptyAndHugeBoxes) {
  const Image image(4, 3);
  EXPECT_THROW(crop(image, {2, 0, 2, 3}), InputError);
  EXPECT_THROW(crop(image, {2, 3, 4, 1}), InputError);
  EXPECT_THROW(crop(image, {0, 0, 40000, 1}), InputError);
  EXPECT_THROW(crop(image, {-2147483647, 0, 2147483647, 1}), InputError);
}

TEST(ConditionBox, IsASquareOneFifthLargerThanTheVisiblePart) {
  // Columns 3 … 13, rows 4 … 8: extent 10, centre (8, 6), half side 6.
  EXPECT_EQ(condition_box(with_alpha(20, 20, {{3, 5, 1}, {13, 8, 255}, {9, 4, 7}})), (PixelBox{2, 0, 14, 12}));
  // Centre (1.5, 1), half side 1.8: corners -0.3, 3.3 and -0.8, 2.8 are cut towards zero, not down.
  EXPECT_EQ(condition_box(with_alpha(5, 5, {{0, 0, 9}, {3, 2, 9}})), (PixelBox{0, 0, 3, 2}));
}

TEST(ConditionBox, RefusesPicturesWithNothingVisible) {
  try {
    condition_box(Image(6, 6, 0xFFFFFF00u), "renders_cond/a/003.png");
    FAIL() << "no error";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("renders_cond/a/003.png"), std::string::npos);
  }
  EXPECT_THROW(condition_box(with_alpha(6, 6, {{2, 2, 255}})), InputError);
  EXPECT_THROW(condition_box(Image()), InputError);
}

TEST(InferenceBox, CountsOnlyNearlyOpaquePixels) {
  // Alpha 204 is not foreground. Extent 10, side 12, halves of 6 around (8, 6.5).
  const Image image = with_alpha(20, 20, {{0, 0, 204}, {3, 5, 205}, {13, 8, 255}});
  EXPECT_EQ(inference_box(image), (PixelBox{2, 0, 14, 12}));
  // Extent 3: side int(3.6) = 3, half 1 around (1.5, 2).
  EXPECT_EQ(inference_box(with_alpha(5, 5, {{0, 1, 255}, {3, 3, 255}})), (PixelBox{0, 1, 2, 3}));
  EXPECT_EQ(inference_box(with_alpha(7, 5, {{3, 3, 100}})), (PixelBox{0, 0, 7, 5}));
  EXPECT_THROW(inference_box(with_alpha(7, 5, {{3, 3, 255}})), InputError);
}

TEST(ImagePlanes, SeparateChannelsAndAlpha) {
  Image image(2, 1);
  image.rgba = {255, 51, 0, 102, 0, 255, 51, 255};
  EXPECT_EQ(color_planes(image), (std::vector<float>{1, 0, 0.2F, 1, 0, 0.2F}));
  EXPECT_EQ(alpha_plane(image), (std::vector<float>{0.4F, 1}));
  const std::vector<float> planes = premultiplied_planes(image);
  EXPECT_FLOAT_EQ(planes[0], 0.4F);
  EXPECT_FLOAT_EQ(planes[2], 0.08F);
  EXPECT_FLOAT_EQ(planes[5], 0.2F);
}

TEST(ImagePlanes, ComposingRoundsDown) {
  Image image(1, 1);
  image.rgba = {255, 128, 3, 127};
  // 255 · 127/255 = 127; 128 · 127/255 = 63.7; 3 · 127/255 = 1.49.
  const Image found = composed_on_black(image);
  EXPECT_EQ(found.pixel(0, 0)[1], 63);
  EXPECT_EQ(found.pixel(0, 0)[2], 1);
  EXPECT_EQ(found.pixel(0, 0)[3], 255);
}

Image with_object(int left, int top, int right, int bottom) {
  Image image(20, 10, 0);
  for (int y = top; y <= bottom; ++y) {
    for (int x = left; x <= right; ++x) {
      image.pixel(x, y)[0] = static_cast<std::uint8_t>(10 * x);
      image.pixel(x, y)[3] = 1;  // any alpha above 0 counts
    }
  }
  return image;
}

TEST(ConditionBox, IsASquareAroundTheObjectWithAMarginOfAFifth) {
  // Centre (9, 4.5), longer side 10, half-size 6: [3, 15) × [-1.5, 10.5), truncated towards zero.
  const PixelBox box = condition_box(with_object(4, 2, 14, 7), "");
  EXPECT_EQ(box.x0, 3);
  EXPECT_EQ(box.x1, 15);
  EXPECT_EQ(box.y0, -1);
  EXPECT_EQ(box.y1, 10);
  EXPECT_THROW(condition_box(Image(4, 4, 0), "x.png"), InputError);
  EXPECT_THROW(condition_box(with_object(3, 3, 3, 3), "x.png"), InputError);
}

TEST(Crop, OutsideThePictureIsTransparentBlack) {
  const Image image = with_object(0, 0, 19, 9);
  const Image part = crop(image, {-2, -1, 3, 2});
  ASSERT_EQ(part.width, 5);
  ASSERT_EQ(part.height, 3);
  EXPECT_EQ(part.pixel(1, 1)[3], 0);
  EXPECT_EQ(part.pixel(4, 0)[3], 0);
  EXPECT_EQ(part.pixel(2, 1)[3], 1);
  EXPECT_EQ(part.pixel(4, 2)[0], 20);
  const Image beyond = crop(image, {30, 30, 32, 33});
  EXPECT_TRUE(std::all_of(beyond.rgba.begin(), beyond.rgba.end(), [](std::uint8_t v) { return v == 0; }));
}

}  // namespace

}  // namespace anigen::io
