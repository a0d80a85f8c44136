#include "anigen/eval/line_chart.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "anigen/core/html.h"
#include "anigen/eval/tables.h"

namespace anigen::eval {
namespace {

constexpr double kWidth = 420, kHeight = 220, kLeft = 58, kRight = 12, kTop = 28, kBottom = 26;

std::string text_of(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

/// A round step (1, 2 or 5 times a power of ten) that divides the range into about four.
double tick_step(double range) {
  const double raw = range / 4, power = std::pow(10.0, std::floor(std::log10(raw)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= raw) return factor * power;
  }
  return 10.0 * power;
}

std::string text_element(double x, double y, const char* anchor, const std::string& text) {
  return "<text x=\"" + text_of(x) + "\" y=\"" + text_of(y) + "\" text-anchor=\"" + anchor + "\">" +
         html_escaped(text) + "</text>";
}

std::string line_element(double x1, double y1, double x2, double y2) {
  return "<line x1=\"" + text_of(x1) + "\" y1=\"" + text_of(y1) + "\" x2=\"" + text_of(x2) + "\" y2=\"" + text_of(y2) +
         "\" stroke=\"#ddd\"/>";
}

}  // namespace

std::string line_chart(const std::string& title, const std::vector<std::pair<double, double>>& points) {
  std::vector<std::pair<double, double>> curve;
  for (const auto& point : points) {
    if (std::isfinite(point.first) && std::isfinite(point.second)) curve.push_back(point);
  }
  if (curve.size() < 2 || !(curve.back().first > curve.front().first)) return "";
  const double x_low = curve.front().first, x_high = curve.back().first;
  double y_low = 0, y_high = 0;  // errors: zero belongs to the picture
  for (const auto& point : curve) {
    y_low = std::min(y_low, point.second);
    y_high = std::max(y_high, point.second);
  }
  if (!(y_high > y_low)) y_high = y_low + 1;
  const auto px = [&](double x) { return kLeft + (x - x_low) / (x_high - x_low) * (kWidth - kLeft - kRight); };
  const auto py = [&](double y) {
    return kHeight - kBottom - (y - y_low) / (y_high - y_low) * (kHeight - kTop - kBottom);
  };

  std::string svg =
      "<svg viewBox=\"0 0 420 220\" width=\"420\" height=\"220\" font-size=\"11\" font-family=\"sans-serif\">";
  svg += "<text x=\"8\" y=\"16\" font-size=\"13\">" + html_escaped(title + ", last " + text_of(curve.back().second)) +
         "</text>";
  const double y_step = tick_step(y_high - y_low), x_step = tick_step(x_high - x_low);
  for (double y = std::ceil(y_low / y_step) * y_step; y <= y_high * (1 + 1e-9); y += y_step) {
    svg += line_element(kLeft, py(y), kWidth - kRight, py(y)) + text_element(kLeft - 6, py(y) + 4, "end", text_of(y));
  }
  for (double x = std::ceil(x_low / x_step) * x_step; x <= x_high * (1 + 1e-9); x += x_step) {
    svg += line_element(px(x), kHeight - kBottom, px(x), kTop) + text_element(px(x), kHeight - 8, "middle", text_of(x));
  }
  svg += "<polyline fill=\"none\" stroke=\"#1565c0\" stroke-width=\"1.6\" points=\"";
  for (const auto& [x, y] : curve) svg += text_of(px(x)) + "," + text_of(py(y)) + " ";
  return svg + "\"/></svg>\n";
}

}  // namespace anigen::eval
