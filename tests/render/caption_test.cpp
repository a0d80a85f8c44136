#include "anigen/render/caption.h"

#include <gtest/gtest.h>

#include <string>

namespace anigen::render {
namespace {

constexpr std::uint32_t kWhite = 0xFFFFFFFFu;
const Eigen::Vector3f kBlue(0.0f, 0.0f, 1.0f);

/// Pixels that ink has reached, both ends included.
struct Ink {
  int left = 1 << 20, top = 1 << 20, right = -1, bottom = -1;
  double pixels = 0.0;
};

Ink ink_of(const io::Image& sheet) {
  Ink ink;
  for (int y = 0; y < sheet.height; ++y) {
    for (int x = 0; x < sheet.width; ++x) {
      const std::uint8_t* pixel = sheet.pixel(x, y);
      EXPECT_EQ(pixel[2], 255) << "blue ink on white";
      EXPECT_EQ(pixel[3], 255) << "alpha";
      ink.pixels += (255 - pixel[0]) / 255.0;
      if (pixel[0] > 127) continue;
      ink.left = std::min(ink.left, x), ink.right = std::max(ink.right, x);
      ink.top = std::min(ink.top, y), ink.bottom = std::max(ink.bottom, y);
    }
  }
  return ink;
}

Ink drawn(const std::string& line, int x, int width, int height) {
  io::Image sheet(300, 60, kWhite);
  put_caption(sheet, line, x, width, 40, height, kBlue);
  return ink_of(sheet);
}

TEST(Captions, StandOnTheirBaselineInTheMiddle) {
  for (const int height : {14, 21, 30}) {
    const Ink ink = drawn("HMH", 20, 250, height);
    EXPECT_NEAR(ink.bottom, 40, 2.0) << height;
    EXPECT_NEAR(ink.bottom - ink.top + 1, height, 3.0);
    EXPECT_NEAR((ink.left + ink.right) / 2.0, 20 + 125, 6.0);
    EXPECT_GT(ink.right - ink.left, height);
  }
}

TEST(Captions, ThatAreTooWideAreReduced) {
  const std::string line(20, 'W');
  const Ink wide = drawn(line, 40, 200, 20), narrow = drawn(line, 40, 100, 20);
  EXPECT_GE(wide.left, 40);
  EXPECT_LE(wide.right, 240);
  EXPECT_GT(wide.right - wide.left, 180);
  EXPECT_LE(narrow.right, 140);
  EXPECT_LT(narrow.bottom - narrow.top, wide.bottom - wide.top);
  EXPECT_LT(narrow.pixels, wide.pixels);
}

TEST(Captions, ShowForeignCharactersAsQuestionMarks) {
  EXPECT_EQ(printable_ascii("Gr\xC3\xB6\xC3\x9F"
                            "e \xE2\x9C\x93\t~"),
            "Gr??e ??~");
  io::Image foreign(200, 60, kWhite), marks(200, 60, kWhite);
  put_caption(foreign, "\xC3\xB6\n", 10, 180, 40, 14, kBlue);
  put_caption(marks, "??", 10, 180, 40, 14, kBlue);
  EXPECT_EQ(foreign.rgba, marks.rgba);
}

TEST(Captions, EveryCharacterButSpaceHasInk) {
  for (char c = '!'; c <= '~'; ++c) EXPECT_GT(drawn(std::string(1, c), 20, 100, 21).pixels, 1.0) << c;
  EXPECT_EQ(drawn("", 20, 100, 21).pixels, 0.0);
  EXPECT_EQ(drawn("   ", 20, 100, 21).pixels, 0.0);
}

TEST(Captions, BeyondTheSheetAreCutOff) {
  io::Image sheet(30, 10, kWhite);
  put_caption(sheet, "Wide gjpq", -40, 100, 5, 14, kBlue);
  put_caption(sheet, "Wide gjpq", 10, 100, 14, 14, kBlue);
  EXPECT_GT(ink_of(sheet).pixels, 1.0);
}

}  // namespace
}  // namespace anigen::render
