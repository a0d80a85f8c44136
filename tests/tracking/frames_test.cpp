#include "anigen/tracking/frames.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen::tracking {
namespace {

namespace fs = std::filesystem;

// The message of what read_video() throws.
std::string refusal(const fs::path& path, const std::vector<std::string>& names = {}) {
  try {
    read_video(path, names);
  } catch (const InputError& error) {
    return error.what();
  }
  return "nothing was thrown";
}

bool says(const std::string& message, const std::string& words) { return message.find(words) != std::string::npos; }

TEST(TrackingFrames, FolderIsReadByName) {
  const test::TemporaryFolder folder;
  io::write_png(folder.path() / "b.png", io::Image(20, 10, 0xFF0000FFu));
  io::write_png(folder.path() / "a.png", io::Image(20, 10, 0xFF00FF00u));
  const Video video = read_video(folder.path());
  ASSERT_EQ(video.frames.size(), 2u);
  EXPECT_TRUE(says(video.names[0], "a.png"));
  EXPECT_EQ(video.frames[0].width, 20);
  EXPECT_EQ(video.fps, 0.0);
  const Video chosen = read_video(folder.path(), {"b.png", "a.png", "b.png"});
  ASSERT_EQ(chosen.frames.size(), 3u);
  EXPECT_TRUE(says(chosen.names[0], "b.png"));
}

TEST(TrackingFrames, BadVideosAreRefusedByName) {
  const test::TemporaryFolder folder;
  EXPECT_TRUE(says(refusal(folder.path() / "none"), "no such folder or file"));
  EXPECT_TRUE(says(refusal(folder.path()), folder.path().string()));  // no picture in it
  io::write_png(folder.path() / "0.png", io::Image(20, 10));
  io::write_png(folder.path() / "1.png", io::Image(10, 20));
  const std::string sizes = refusal(folder.path());
  EXPECT_TRUE(says(sizes, "1.png") && says(sizes, "10 x 20") && says(sizes, "20 x 10")) << sizes;
  EXPECT_TRUE(says(refusal(folder.path(), {"2.png"}), "2.png"));
  io::write_png(folder.path() / "1.png", io::Image(4, 4));
  EXPECT_TRUE(says(refusal(folder.path(), {"1.png"}), "too few"));
}

TEST(TrackingFrames, LevelHoldsCoverageColourAndDistance) {
  io::Image image(64, 64, 0);
  for (int y = 16; y < 48; ++y) {
    for (int x = 32; x < 48; ++x) {
      std::uint8_t* pixel = image.pixel(x, y);
      pixel[0] = 255, pixel[3] = 255;
    }
  }
  const FrameLevel level = frame_level(image, 32, "frame");
  EXPECT_DOUBLE_EQ(level.area, 16.0 * 8.0);
  EXPECT_DOUBLE_EQ(level.alpha[12][20].item<double>(), 1.0);
  EXPECT_DOUBLE_EQ(level.color[12][20][0].item<double>(), 1.0);
  EXPECT_DOUBLE_EQ(level.color[12][20][1].item<double>(), 0.0);
  EXPECT_DOUBLE_EQ(level.outside[12][20].item<double>(), 0.0);
  EXPECT_NEAR(level.outside[12][6].item<double>(), 10.0 / 32.0, 1e-6);  // columns 16 … 23 are inside
  const Tensor low = level.points.amin(0), high = level.points.amax(0);
  EXPECT_NEAR(low[0].item<double>(), 16.5 / 32.0, 1e-9);
  EXPECT_NEAR(high[1].item<double>(), 23.5 / 32.0, 1e-9);
  EXPECT_THROW(frame_level(io::Image(16, 16, 0), 8, "empty"), InputError);
  EXPECT_THROW(frame_level(io::Image(16, 8), 8, "wide"), InputError);
}

TEST(TrackingFrames, SquaresKeepTheFrameInTheMiddle) {
  const io::Image square = squared(io::Image(20, 10, 0xFFFFFFFFu));
  EXPECT_EQ(square.width, 20);
  EXPECT_EQ(square.height, 20);
  EXPECT_EQ(square.pixel(10, 4)[3], 0);
  EXPECT_EQ(square.pixel(10, 5)[3], 255);
  EXPECT_EQ(square.pixel(10, 14)[3], 255);
  EXPECT_EQ(square.pixel(10, 15)[3], 0);
}

}  // namespace
}  // namespace anigen::tracking
