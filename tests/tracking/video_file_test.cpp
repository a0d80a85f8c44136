#include "anigen/tracking/video_file.h"

#include <gtest/gtest.h>

#include <fstream>
#include <string>

#include "anigen/core/error.h"
#include "tests/support/paths.h"

#include <opencv2/videoio.hpp>

namespace anigen::tracking {
namespace {

namespace fs = std::filesystem;

void expect_unreadable(const fs::path& file, const std::string& words) {
  try {
    read_video(file);
    ADD_FAILURE() << "accepted; expected: " << words;
  } catch (const InputError& error) {
    EXPECT_EQ(error.file(), file.string());
    EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
  }
}

TEST(TrackingVideoFiles, ThatHoldNoVideoAreRefused) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "broken.mp4") << "no video";
  expect_unreadable(folder.path() / "broken.mp4", "is no video that OpenCV reads");
  std::ofstream(folder.path() / "empty.mp4").flush();
  expect_unreadable(folder.path() / "empty.mp4", "empty.mp4");
}

TEST(TrackingVideoFiles, AreReadWithTheirRate) {
  const test::TemporaryFolder folder;
  const fs::path file = folder.path() / "six.avi";
  {
    cv::VideoWriter writer(file.string(), cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 12.0, {48, 32});
    if (!writer.isOpened()) GTEST_SKIP() << "this OpenCV writes no video";
    for (int n = 0; n < 6; ++n) writer.write(cv::Mat(32, 48, CV_8UC3, cv::Scalar(0, 0, 40 * n)));
  }
  const Video video = read_video(file);
  ASSERT_EQ(video.frames.size(), 6u);
  EXPECT_NEAR(video.fps, 12.0, 1e-6);
  EXPECT_EQ(video.frames[0].width, 48);
  EXPECT_NEAR(video.frames[5].pixel(24, 16)[0], 200, 8);  // red comes first
  EXPECT_NEAR(video.frames[5].pixel(24, 16)[2], 0, 8);
}

}  // namespace
}  // namespace anigen::tracking
