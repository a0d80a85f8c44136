#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "anigen/render/caption.h"

namespace anigen::render {

namespace {

constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
constexpr int kCapital = 21;  ///< height of this font's capitals at scale 1, pixels

}  // namespace

void put_caption(io::Image& sheet, const std::string& line, int x, int width, int y, int height,
                 const Eigen::Vector3f& color) {
  cv::Mat canvas(sheet.height, sheet.width, CV_8UC4, sheet.rgba.data());
  const std::string text = printable_ascii(line);
  double scale = static_cast<double>(height) / kCapital;
  int baseline = 0;
  const int natural = cv::getTextSize(text, kFont, scale, 1, &baseline).width;
  if (natural > width && natural > 0) scale *= static_cast<double>(width) / natural;
  const int thickness = scale > 0.9 ? 2 : 1;
  const int actual = cv::getTextSize(text, kFont, scale, thickness, &baseline).width;
  const std::array<std::uint8_t, 3> bytes = color_bytes(color);
  cv::putText(canvas, text, {x + std::max(0, (width - actual) / 2), y}, kFont, scale,
              cv::Scalar(bytes[0], bytes[1], bytes[2], 255), thickness, cv::LINE_AA);
}

}  // namespace anigen::render
