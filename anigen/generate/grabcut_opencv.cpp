#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "anigen/generate/grabcut.h"
#include "anigen/generate/mask_parts.h"

namespace anigen::generate {

namespace {

constexpr int kWorkingSide = 512, kRounds = 5, kEdgeColors = 6;
constexpr double kEdgePart = 0.02;      // of the shorter side: surely background
constexpr double kRarePart = 0.02;      // an edge colour below it may be the object, reaching the edge
constexpr double kStandsOut = 0.35;     // of Otsu's threshold: what lies below it is background at first
constexpr double kLeastDistance = 4.0;  // in CIELAB: noise and compression stay below
constexpr double kSmallestPart = 0.05;  // of the largest part

// OpenCV's k-means draws from a generator of the thread: the same numbers every time, and nobody else's are disturbed.
class FixedDraws {
 public:
  FixedDraws() : before_(cv::theRNG().state) { cv::theRNG().state = 1; }
  ~FixedDraws() { cv::theRNG().state = before_; }
  FixedDraws(const FixedDraws&) = delete;
  FixedDraws& operator=(const FixedDraws&) = delete;

 private:
  std::uint64_t before_;
};

cv::Mat working_copy(const io::Image& image) {
  const cv::Mat rgba(image.height, image.width, CV_8UC4, const_cast<std::uint8_t*>(image.rgba.data()));
  cv::Mat bgr;
  cv::cvtColor(rgba, bgr, cv::COLOR_RGBA2BGR);
  const double scale = static_cast<double>(kWorkingSide) / std::max(image.width, image.height);
  if (scale >= 1.0) return bgr;
  const auto side = [scale](int length) { return std::max(1, static_cast<int>(std::lround(scale * length))); };
  cv::Mat small;
  cv::resize(bgr, small, cv::Size(side(image.width), side(image.height)), 0.0, 0.0, cv::INTER_AREA);
  return small;
}

// 255 along the edge of the picture, 0 inside.
cv::Mat edge_of(const cv::Size& size) {
  const int width = std::max(1, static_cast<int>(std::lround(kEdgePart * std::min(size.width, size.height))));
  cv::Mat edge(size, CV_8U, cv::Scalar(255));
  if (size.width > 2 * width && size.height > 2 * width)
    edge(cv::Rect(width, width, size.width - 2 * width, size.height - 2 * width)).setTo(0);
  return edge;
}

// The colours that are common along the edge, [K, 3].
cv::Mat edge_colors(const cv::Mat& lab, const cv::Mat& edge) {
  std::vector<cv::Vec3f> samples;
  for (int y = 0; y < lab.rows; ++y) {
    for (int x = 0; x < lab.cols; ++x) {
      if (edge.at<std::uint8_t>(y, x) != 0) samples.push_back(lab.at<cv::Vec3f>(y, x));
    }
  }
  const cv::Mat table(static_cast<int>(samples.size()), 3, CV_32F, samples.data());
  cv::Mat labels, centers, common;
  cv::kmeans(table, std::min(kEdgeColors, table.rows), labels,
             cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 20, 0.1), 2, cv::KMEANS_PP_CENTERS,
             centers);
  for (int k = 0; k < centers.rows; ++k) {
    if (cv::countNonZero(labels == k) >= kRarePart * table.rows) common.push_back(centers.row(k));
  }
  return common;
}

// Of every pixel to the nearest edge colour, CIELAB.
cv::Mat distance_to_edge(const cv::Mat& bgr, const cv::Mat& edge) {
  cv::Mat lab;
  bgr.convertTo(lab, CV_32F, 1.0 / 255.0);
  cv::cvtColor(lab, lab, cv::COLOR_BGR2Lab);
  cv::GaussianBlur(lab, lab, cv::Size(0, 0), 1.0);
  const cv::Mat colors = edge_colors(lab, edge);
  cv::Mat distance(lab.size(), CV_32F);
  for (int y = 0; y < lab.rows; ++y) {
    for (int x = 0; x < lab.cols; ++x) {
      double nearest = std::numeric_limits<double>::max();
      for (int k = 0; k < colors.rows; ++k) {
        const cv::Vec3f color(colors.at<float>(k, 0), colors.at<float>(k, 1), colors.at<float>(k, 2));
        nearest = std::min(nearest, cv::norm(lab.at<cv::Vec3f>(y, x) - color));
      }
      distance.at<float>(y, x) = static_cast<float>(nearest);
    }
  }
  return distance;
}

// Between the background's distances and the object's.
double standing_out(const cv::Mat& distance) {
  constexpr double kSteps = 2.0;  // of the histogram, per unit
  cv::Mat bytes, unused;
  distance.convertTo(bytes, CV_8U, kSteps);
  const double otsu = cv::threshold(bytes, unused, 0.0, 255.0, cv::THRESH_BINARY | cv::THRESH_OTSU) / kSteps;
  return std::max(kLeastDistance, kStandsOut * otsu);
}

}  // namespace

bool has_grabcut() { return true; }

std::vector<std::uint8_t> grabcut_mask(const io::Image& image) {
  std::vector<std::uint8_t> alpha(image.rgba.size() / io::kImageChannels, 0);
  if (alpha.empty()) return alpha;
  const FixedDraws fixed;
  const cv::Mat small = working_copy(image);
  const cv::Mat edge = edge_of(small.size());
  const cv::Mat distance = distance_to_edge(small, edge);
  cv::Mat classes(small.size(), CV_8U, cv::Scalar(cv::GC_PR_FGD));
  classes.setTo(cv::GC_PR_BGD, distance < standing_out(distance));
  classes.setTo(cv::GC_BGD, edge);
  if (cv::countNonZero(classes == cv::GC_PR_FGD) == 0) return alpha;
  cv::Mat background, foreground;  // GrabCut's colour models
  cv::grabCut(small, classes, cv::Rect(), background, foreground, kRounds, cv::GC_INIT_WITH_MASK);
  std::vector<std::uint8_t> kept(static_cast<std::size_t>(small.cols) * static_cast<std::size_t>(small.rows));
  cv::Mat mask(small.size(), CV_8U, kept.data());
  cv::compare(classes, cv::GC_PR_FGD, mask, cv::CMP_EQ);
  drop_small_parts(kept, small.cols, small.rows, kSmallestPart);
  cv::Mat full(image.height, image.width, CV_8U, alpha.data());
  cv::resize(mask, full, full.size(), 0.0, 0.0, cv::INTER_LINEAR);
  return alpha;
}

}  // namespace anigen::generate
