
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <new>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/generate/picture_input.h"
#include "tests/support/paths.h"

namespace anigen::generate {
namespace {

class PictureFormats : public ::testing::Test {
 protected:
  std::filesystem::path stored(const std::string& name, const cv::Mat& picture) {
    std::vector<std::uint8_t> bytes;
    if (!cv::imencode(std::filesystem::path(name).extension().string(), picture, bytes)) throw std::bad_alloc();
    write_file_atomically(folder_ / name, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    return folder_ / name;
  }
  PreprocessedImage preprocessed(const std::string& name, const cv::Mat& picture) {
    PreprocessingOptions options;
    options.size = 40;
    return ImagePreprocessor(options).run(stored(name, picture));
  }
  test::TemporaryFolder folder_;
};

TEST_F(PictureFormats, AllGiveTheSameObject) {
  cv::Mat picture(60, 80, CV_8UC3, cv::Scalar(190, 190, 190));
  picture(cv::Rect(25, 15, 30, 32)).setTo(cv::Scalar(40, 60, 200));
  cv::Mat deep, grey;
  picture.convertTo(deep, CV_16U, 257.0);
  const io::Image reference = preprocessed("picture.png", picture).picture;
  for (const char* name : {"picture.bmp", "picture.tif", "picture.jpg", "picture.webp", "deep.png", "deep.tiff"}) {
    const bool is_deep = std::string(name).rfind("deep", 0) == 0;
    const io::Image found = preprocessed(name, is_deep ? deep : picture).picture;
    double difference = 0.0;
    for (std::size_t i = 0; i < found.rgba.size(); ++i) difference += std::abs(found.rgba[i] - reference.rgba[i]);
    EXPECT_LT(difference / static_cast<double>(found.rgba.size()), 8.0) << name;  // JPEG and WebP lose colour at edges
  }
  cv::extractChannel(picture, grey, 0);
  const PreprocessedImage found = preprocessed("grey.png", grey);
  EXPECT_EQ(found.picture.pixel(20, 20)[0], found.picture.pixel(20, 20)[2]);
  EXPECT_EQ(found.picture.pixel(20, 20)[0], 40);
}

TEST_F(PictureFormats, WithNothingThatStandsOutAreRefused) {
  for (const char* name : {"blank.jpg", "blank.bmp"}) {
    try {
      preprocessed(name, cv::Mat(64, 64, CV_8UC3, cv::Scalar(200, 100, 50)));
      ADD_FAILURE() << name << " is accepted";
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("no object stands out"), std::string::npos) << error.what();
      EXPECT_EQ(error.file(), (folder_ / name).string());
    }
  }
  EXPECT_THROW(preprocessed("line.bmp", cv::Mat(3, 400, CV_8UC3, cv::Scalar(1, 2, 3))), InputError);
}

}  // namespace
}  // namespace anigen::generate
