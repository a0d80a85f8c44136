#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/render/picture.h"
#include "tests/render/shapes.h"

namespace anigen::render {
namespace {

constexpr std::uint32_t kRed = 0xFF0000FFu, kGreen = 0x00FF00FFu;  // RGBA

TEST(ContactSheet, TilesInReadingOrder) {
  SheetOptions options;
  options.columns = 2;
  options.gap = 4;
  const io::Image sheet = contact_sheet(
      {{io::Image(20, 10, kRed), ""}, {io::Image(20, 10, kGreen), ""}, {io::Image(20, 10, kGreen), ""}}, options);
  EXPECT_EQ(sheet.width, 3 * 4 + 2 * 20);
  EXPECT_EQ(sheet.height, 3 * 4 + 2 * 10);
  EXPECT_EQ(sheet.pixel(4 + 10, 4 + 5)[0], 255);
  EXPECT_EQ(sheet.pixel(4 + 10, 4 + 5)[1], 0);
  EXPECT_EQ(sheet.pixel(28 + 10, 4 + 5)[1], 255);
  EXPECT_EQ(sheet.pixel(28 + 10, 4 + 5)[0], 0);
  EXPECT_EQ(sheet.pixel(14, 18 + 5)[1], 255);
  EXPECT_EQ(sheet.pixel(1, 1)[0], 255);  // the gap is background
  EXPECT_EQ(sheet.pixel(1, 1)[1], 255);
}

TEST(ContactSheet, CaptionsAndTitleAddInkBelowAndAbove) {
  SheetOptions options;
  options.title = "Title";
  const io::Image sheet = contact_sheet({{io::Image(120, 40, kRed), "caption"}}, options);
  const auto dark = [&](int from, int to) {
    int count = 0;
    for (int y = from; y < to; ++y) {
      for (int x = 0; x < sheet.width; ++x) count += sheet.pixel(x, y)[0] < 100;
    }
    return count;
  };
  const int tile_top = 3 * options.text_height + options.gap;
  EXPECT_GT(dark(0, tile_top), 20);
  EXPECT_EQ(dark(tile_top, tile_top + 40), 0);
  EXPECT_GT(dark(tile_top + 40, sheet.height), 20);
}

TEST(ContactSheet, LongAndForeignCaptionsStayInTheirCell) {
  const std::string longest(500, 'W');
  const io::Image sheet = contact_sheet({{io::Image(60, 20, kRed), longest}, {io::Image(60, 20, kGreen), "Größe ✓"}});
  for (int y = 0; y < sheet.height; ++y) EXPECT_EQ(sheet.pixel(2, y)[1], 255) << "ink in the margin, row " << y;
}

TEST(ContactSheet, TransparentPicturesShowTheSheet) {
  const io::Image sheet = contact_sheet({{io::Image(10, 10, 0x00000000u), ""}});
  EXPECT_EQ(sheet.pixel(17, 17)[0], 255);
  EXPECT_EQ(sheet.pixel(17, 17)[3], 255);
}

TEST(ContactSheet, RefusesNothingAndTooMuch) {
  EXPECT_THROW(contact_sheet({}), InputError);
  SheetOptions options;
  options.columns = 3;
  const std::vector<Tile> wide(3, {io::Image(6000, 1), ""});
  EXPECT_THROW(contact_sheet(wide, options), InputError);
  options.gap = -1;
  EXPECT_THROW(contact_sheet({{io::Image(2, 2), ""}}, options), InputError);
  Tile broken{io::Image(4, 4), ""};
  broken.image.rgba.resize(3);
  EXPECT_THROW(contact_sheet({broken}), InputError);
}

TEST(ContactSheet, LeftIsLeft) {
  SheetOptions options;
  options.columns = 2;
  const io::Image pair =
      contact_sheet({{io::Image(30, 30, kRed), "truth"}, {io::Image(30, 30, kGreen), "prediction"}}, options);
  EXPECT_EQ(pair.pixel(pair.width / 4, 20)[0], 255);
  EXPECT_EQ(pair.pixel(3 * pair.width / 4, 20)[1], 255);
  EXPECT_EQ(pair.pixel(3 * pair.width / 4, 20)[0], 0);
}

TEST(Turntable, TurnsCounterClockwiseAtOneDistance) {
  Asset asset = test::wall();  // wide seen from the front, a line seen from the side
  PictureOptions options;
  options.mode = PictureMode::kNormals;
  options.background.reset();
  options.width = options.height = 64;
  options.view.yaw_degrees = options.view.pitch_degrees = 0;
  const std::vector<io::Image> views = turntable(asset, options, 4);
  ASSERT_EQ(views.size(), 4u);
  std::vector<int> covered;
  for (const io::Image& view : views) {
    int count = 0;
    for (std::size_t i = 3; i < view.rgba.size(); i += 4) count += view.rgba[i] > 127;
    covered.push_back(count);
  }
  EXPECT_GT(covered[0], 64 * 64 / 2);
  EXPECT_NEAR(covered[0], covered[2], 4);
  EXPECT_LT(covered[1], 64);
  EXPECT_NEAR(views[0].pixel(32, 32)[1], 0, 1);    // front: −Y
  EXPECT_NEAR(views[2].pixel(32, 32)[1], 255, 1);  // back: +Y
  EXPECT_THROW(turntable(asset, options, 0), InputError);
}

TEST(Palette, NeighbouringJointsDiffer) {
  for (int j = 0; j < 200; ++j) {
    for (int k = j + 1; k < j + 5; ++k)
      EXPECT_GT((joint_color(j) - joint_color(k)).cwiseAbs().maxCoeff(), 0.12f) << j << " and " << k;
    EXPECT_GE(joint_color(j).minCoeff(), 0.0f);
    EXPECT_LE(joint_color(j).maxCoeff(), 1.0f);
  }
  EXPECT_EQ(joint_color(12), joint_color(12));
}

TEST(Palette, HeatRisesThroughItsStopsAndClamps) {
  EXPECT_EQ(heat_color(-1.0f), heat_color(0.0f));
  EXPECT_EQ(heat_color(2.0f), heat_color(1.0f));
  EXPECT_EQ(heat_color(std::nanf("")), heat_color(0.0f));
  EXPECT_GT(heat_color(1.0f).x(), heat_color(0.0f).x() + 0.5f);
  EXPECT_GT(heat_color(0.0f).z(), heat_color(1.0f).z());
}

}  // namespace
}  // namespace anigen::render
