#include "anigen/generate/mask_parts.h"

#include <gtest/gtest.h>

#include <string>

#include "anigen/core/error.h"

namespace anigen::generate {
namespace {

using Rows = std::vector<std::string>;

// '#' is set.
Rows without_small_parts(const Rows& rows, double share) {
  const std::size_t width = rows.front().size();
  std::vector<std::uint8_t> mask;
  for (const std::string& row : rows) {
    for (const char c : row) mask.push_back(c == '#' ? 200 : 0);
  }
  drop_small_parts(mask, static_cast<int>(width), static_cast<int>(rows.size()), share);
  Rows left(rows.size(), std::string(width, '.'));
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if (mask[i] == 0) continue;
    EXPECT_EQ(mask[i], 200) << "values that stay are not changed";
    left[i / width][i % width] = '#';
  }
  return left;
}

TEST(MaskParts, PixelsThatTouchAtCornersAreOnePart) {
  const Rows zigzag = {"#.#..", ".#.#.", "....#", ".....", "##..."};
  EXPECT_EQ(without_small_parts(zigzag, 0.5), (Rows{"#.#..", ".#.#.", "....#", ".....", "....."}));
  // The last column and the first one of the next row do not touch.
  const Rows edges = {"...##", "#..##", ".....", "#...."};
  EXPECT_EQ(without_small_parts(edges, 0.5), (Rows{"...##", "...##", ".....", "....."}));
}

TEST(MaskParts, ArmsThatMeetBelowAreOnePart) {
  const Rows fork = {"#.#.#", "#.#.#", "#####", ".....", "###.."};
  EXPECT_EQ(without_small_parts(fork, 0.5), (Rows{"#.#.#", "#.#.#", "#####", ".....", "....."}));
}

TEST(MaskParts, TheShareItselfIsKept) {
  const Rows rows = {"####..#", "......#"};
  EXPECT_EQ(without_small_parts(rows, 0.5), rows);
  EXPECT_EQ(without_small_parts(rows, 0.51), (Rows{"####...", "......."}));
  EXPECT_EQ(without_small_parts(rows, 0.0), rows);
  EXPECT_EQ(without_small_parts(rows, 1.0), (Rows{"####...", "......."}));
}

TEST(MaskParts, EmptyMasksStayEmpty) {
  EXPECT_EQ(without_small_parts({"...", "..."}, 0.5), (Rows{"...", "..."}));
  std::vector<std::uint8_t> none;
  drop_small_parts(none, 0, 0, 0.5);
  EXPECT_TRUE(none.empty());
  std::vector<std::uint8_t> four(4, 1);
  EXPECT_THROW(drop_small_parts(four, 3, 2, 0.5), InputError);
}

}  // namespace
}  // namespace anigen::generate
