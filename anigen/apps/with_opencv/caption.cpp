#include <algorithm>
#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>

#include "anigen/io/image.h"

namespace anigen::render {

namespace {

constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
constexpr int kCapital = 21;  ///< height of this font's capitals at scale 1, pixels

}  // namespace

/// The entry that put_caption() looks for. @param text printable ASCII
extern "C" __attribute__((visibility("default"))) void anigen_opencv_caption(io::Image& sheet, const std::string& text,
                                                                             int x, int width, int y, int height,
                                                                             const std::array<std::uint8_t, 3>& color) {
  cv::Mat canvas(sheet.height, sheet.width, CV_8UC4, sheet.rgba.data());
  double scale = static_cast<double>(height) / kCapital;
  int baseline = 0;
  const int natural = cv::getTextSize(text, kFont, scale, 1, &baseline).width;
  if (natural > width && natural > 0) scale *= static_cast<double>(width) / natural;
  const int thickness = scale > 0.9 ? 2 : 1;
  const int actual = cv::getTextSize(text, kFont, scale, thickness, &baseline).width;
  cv::putText(canvas, text, {x + std::max(0, (width - actual) / 2), y}, kFont, scale,
              cv::Scalar(color[0], color[1], color[2], 255), thickness, cv::LINE_AA);
}

}  // namespace anigen::render
