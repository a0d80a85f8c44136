// Pieces of reading a published dataset that do not need one on disk.
#include <gtest/gtest.h>

#include <algorithm>

#include "anigen/core/error.h"
#include "anigen/loaders/files/condition_crop.h"
#include "anigen/loaders/files/skin_rows.h"

namespace anigen::loaders {
namespace {

io::Image with_object(int left, int top, int right, int bottom) {
  io::Image image(20, 10, 0);
  for (int y = top; y <= bottom; ++y) {
    for (int x = left; x <= right; ++x) {
      image.pixel(x, y)[0] = static_cast<std::uint8_t>(10 * x);
      image.pixel(x, y)[3] = 1;  // any alpha above 0 counts
    }
  }
  return image;
}

TEST(ConditionCrop, SquareAroundTheObjectWithAMarginOfAFifth) {
  // Centre (9, 4.5), longer side 10, half-size 6: [3, 15) × [-1.5, 10.5), truncated towards zero.
  const CropBox box = condition_crop(with_object(4, 2, 14, 7), "");
  EXPECT_EQ(box.left, 3);
  EXPECT_EQ(box.right, 15);
  EXPECT_EQ(box.top, -1);
  EXPECT_EQ(box.bottom, 10);
  EXPECT_THROW(condition_crop(io::Image(4, 4, 0), "x.png"), InputError);
  EXPECT_THROW(condition_crop(with_object(3, 3, 3, 3), "x.png"), InputError);
}

TEST(ConditionCrop, OutsideThePictureIsTransparentBlack) {
  const io::Image image = with_object(0, 0, 19, 9);
  const io::Image part = crop(image, {-2, -1, 3, 2});
  ASSERT_EQ(part.width, 5);
  ASSERT_EQ(part.height, 3);
  EXPECT_EQ(part.pixel(1, 1)[3], 0);
  EXPECT_EQ(part.pixel(4, 0)[3], 0);
  EXPECT_EQ(part.pixel(2, 1)[3], 1);
  EXPECT_EQ(part.pixel(4, 2)[0], 20);
  const io::Image beyond = crop(image, {30, 30, 32, 33});
  EXPECT_TRUE(std::all_of(beyond.rgba.begin(), beyond.rgba.end(), [](std::uint8_t v) { return v == 0; }));
}

TEST(SkinRows, ZeroRowsGoToJointZeroAndRowsSumToOne) {
  std::vector<float> skin{0, 0, 0, 0, 2, 6, 0.5f, 0.25f, 0.25f};
  normalize_skin_rows(skin, 3);
  EXPECT_EQ(skin, (std::vector<float>{1, 0, 0, 0, 0.25f, 0.75f, 0.5f, 0.25f, 0.25f}));
}

TEST(SkinRows, FlowAddsSubtreesOfTheFirstRoot) {
  // 1 is the root; 0 and 2 hang from it, 3 from 2; 4 is a second root with 5 below it, which stay alone.
  const std::vector<int> parents{1, -1, 1, 2, -1, 4};
  std::vector<float> skin{0.125f, 0.125f, 0.25f, 0.25f, 0.0625f, 0.125f};
  accumulate_skin_as_flow(skin, parents);
  EXPECT_EQ(skin, (std::vector<float>{0.125f, 0.75f, 0.5f, 0.25f, 0.0625f, 0.125f}));
  std::vector<float> heavy{0.75f, 0.75f};
  accumulate_skin_as_flow(heavy, {-1, 0});
  EXPECT_EQ(heavy, (std::vector<float>{1.0f, 0.75f})) << "clipped";
}

}  // namespace
}  // namespace anigen::loaders
