#include "anigen/core/chart.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>

#include "anigen/core/table.h"

namespace anigen {

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

/// Only what is finite; empty when that makes no line.
std::vector<std::pair<double, double>> drawable(const std::vector<std::pair<double, double>>& points) {
  std::vector<std::pair<double, double>> curve;
  for (const auto& point : points) {
    if (std::isfinite(point.first) && std::isfinite(point.second)) curve.push_back(point);
  }
  if (curve.size() < 2 || !(curve.back().first > curve.front().first)) curve.clear();
  return curve;
}

/// Positions of numbers in the chart.
struct Frame {
  double x_low, x_high, y_low = 0, y_high = 0;  // errors: zero belongs to the picture

  explicit Frame(const std::vector<Curve>& curves)
      : x_low(curves.front().points.front().first), x_high(curves.front().points.back().first) {
    for (const Curve& curve : curves) {
      x_low = std::min(x_low, curve.points.front().first);
      x_high = std::max(x_high, curve.points.back().first);
      for (const auto& point : curve.points) {
        y_low = std::min(y_low, point.second);
        y_high = std::max(y_high, point.second);
      }
    }
    if (!(y_high > y_low)) y_high = y_low + 1;
  }
  double x(double value) const { return kLeft + (value - x_low) / (x_high - x_low) * (kWidth - kLeft - kRight); }
  double y(double value) const {
    return kHeight - kBottom - (value - y_low) / (y_high - y_low) * (kHeight - kTop - kBottom);
  }
};

std::string grid(const Frame& frame) {
  std::string svg;
  const double y_step = tick_step(frame.y_high - frame.y_low), x_step = tick_step(frame.x_high - frame.x_low);
  for (double y = std::ceil(frame.y_low / y_step) * y_step; y <= frame.y_high * (1 + 1e-9); y += y_step) {
    svg += line_element(kLeft, frame.y(y), kWidth - kRight, frame.y(y)) +
           text_element(kLeft - 6, frame.y(y) + 4, "end", text_of(y));
  }
  for (double x = std::ceil(frame.x_low / x_step) * x_step; x <= frame.x_high * (1 + 1e-9); x += x_step) {
    svg += line_element(frame.x(x), kHeight - kBottom, frame.x(x), kTop) +
           text_element(frame.x(x), kHeight - 8, "middle", text_of(x));
  }
  return svg;
}

std::string svg_of(const std::string& title, const std::vector<Curve>& curves, bool legend) {
  // Told apart by people who do not see all colours: Okabe and Ito 2008, darkest first.
  constexpr const char* kColors[] = {"#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"};
  constexpr double kLegendLine = 15;
  const double height = kHeight + (legend ? kLegendLine * static_cast<double>(curves.size()) + 4 : 0);
  std::string svg = "<svg viewBox=\"0 0 420 " + text_of(height) + "\" width=\"420\" height=\"" + text_of(height) +
                    "\" font-size=\"11\" font-family=\"sans-serif\">";
  svg += "<text x=\"8\" y=\"16\" font-size=\"13\">" + html_escaped(title) + "</text>";
  const Frame frame(curves);
  svg += grid(frame);
  for (std::size_t c = 0; c < curves.size(); ++c) {
    const std::string color = kColors[c % std::size(kColors)];
    svg += "<polyline fill=\"none\" stroke=\"" + color + "\" stroke-width=\"1.6\" points=\"";
    for (const auto& [x, y] : curves[c].points) svg += text_of(frame.x(x)) + "," + text_of(frame.y(y)) + " ";
    svg += "\"/>";
    if (!legend) continue;
    const double y = kHeight + kLegendLine * static_cast<double>(c) + 8;
    svg += "<line x1=\"58\" x2=\"78\" y1=\"" + text_of(y - 4) + "\" y2=\"" + text_of(y - 4) + "\" stroke=\"" + color +
           "\" stroke-width=\"2\"/>" +
           text_element(84, y, "start",
                        curves[c].label + (curves[c].label.empty() ? "last " : ", last ") +
                            text_of(curves[c].points.back().second));
  }
  return svg + "</svg>\n";
}

}  // namespace

std::string line_chart(const std::string& title, const std::vector<std::pair<double, double>>& points) {
  const Curve curve{"", drawable(points)};
  if (curve.points.empty()) return "";
  return svg_of(title + ", last " + text_of(curve.points.back().second), {curve}, false);
}

std::string curves_chart(const std::string& title, const std::vector<Curve>& curves) {
  std::vector<Curve> shown;
  for (const Curve& curve : curves) {
    Curve kept{curve.label, drawable(curve.points)};
    if (!kept.points.empty()) shown.push_back(std::move(kept));
  }
  return shown.empty() ? "" : svg_of(title, shown, true);
}

}  // namespace anigen
