#include "anigen/prepare/card/histogram.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>

namespace anigen::prepare {
namespace {

/// The smallest of 1, 2, 5 times a power of ten that is not below a positive number.
double round_up(double value) {
  const double decade = std::pow(10.0, std::floor(std::log10(value)));
  for (const double step : {1.0, 2.0, 5.0}) {
    if (step * decade >= value * (1.0 - 1e-9)) return step * decade;
  }
  return 10.0 * decade;
}

std::vector<double> equal_edges(double low, double high, std::size_t most) {
  const double width = high > low ? round_up((high - low) / static_cast<double>(most - 1)) : 1.0;
  std::vector<double> edges{std::floor(low / width) * width};
  while (edges.back() <= high && edges.size() <= most)
    edges.push_back(edges.front() + width * static_cast<double>(edges.size()));
  return edges;
}

/// 1, 2, 5, 10, …: every number is at most 2.5 times the one before. Decades only when that makes too many.
std::vector<double> decade_edges(double low, double high, std::size_t most) {
  const double first = std::pow(10.0, std::floor(std::log10(low)));
  for (const std::vector<double>& steps : {std::vector<double>{1, 2, 5}, std::vector<double>{1}}) {
    std::vector<double> edges;
    for (double decade = first; edges.empty() || edges.back() <= high; decade *= 10.0) {
      for (const double step : steps) {
        if (edges.empty() || edges.back() <= high) edges.push_back(step * decade);
      }
    }
    while (edges.size() > 2 && edges[1] <= low) edges.erase(edges.begin());
    if (edges.size() <= most + 1) return edges;
  }
  return {low, high};
}

std::string text_of(const char* format, double value) {
  char text[48];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

}  // namespace

std::vector<HistogramBin> histogram(const std::vector<double>& values, std::size_t most) {
  if (values.empty()) return {};
  const auto [least, largest] = std::minmax_element(values.begin(), values.end());
  const bool wide = *least > 0.0 && *largest / *least > 100.0;
  const std::vector<double> edges =
      wide ? decade_edges(*least, *largest, most) : equal_edges(*least, *largest, std::max<std::size_t>(2, most));
  std::vector<HistogramBin> bins;
  for (std::size_t i = 0; i + 1 < edges.size(); ++i) bins.push_back({edges[i], edges[i + 1], 0});
  for (const double value : values) {
    const auto above = std::upper_bound(edges.begin(), edges.end(), value) - edges.begin();
    const auto bin = std::clamp<std::ptrdiff_t>(above - 1, 0, static_cast<std::ptrdiff_t>(bins.size()) - 1);
    ++bins[static_cast<std::size_t>(bin)].count;
  }
  return bins;
}

Spread spread(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const double sum = std::accumulate(values.begin(), values.end(), 0.0);
  return {values.front(), values[values.size() / 2], sum / static_cast<double>(values.size()), values.back()};
}

std::string short_number(double value) {
  if (value >= 1e6) return text_of("%.3gM", value / 1e6);
  if (value >= 1e3) return text_of("%.3gk", value / 1e3);
  return text_of("%.3g", value);
}

std::string histogram_svg(const std::vector<HistogramBin>& bins) {
  if (bins.empty()) return "";
  std::size_t tallest = 1;
  for (const HistogramBin& bin : bins) tallest = std::max(tallest, bin.count);
  constexpr double kWidth = 46, kHeight = 120, kTop = 16, kBottom = 18;
  const double width = kWidth * static_cast<double>(bins.size());
  std::string svg = "<svg viewBox=\"0 0 " + text_of("%.0f", width) + " " + text_of("%.0f", kTop + kHeight + kBottom) +
                    "\" width=\"" + text_of("%.0f", width) + "\" role=\"img\">\n";
  for (std::size_t i = 0; i < bins.size(); ++i) {
    const double x = kWidth * static_cast<double>(i);
    const double height = kHeight * static_cast<double>(bins[i].count) / static_cast<double>(tallest);
    svg += "<rect x=\"" + text_of("%.0f", x + 2) + "\" y=\"" + text_of("%.1f", kTop + kHeight - height) +
           "\" width=\"" + text_of("%.0f", kWidth - 4) + "\" height=\"" + text_of("%.1f", height) + "\"/>";
    if (bins[i].count > 0) {
      svg += "<text x=\"" + text_of("%.0f", x + kWidth / 2) + "\" y=\"" + text_of("%.1f", kTop + kHeight - height - 3) +
             "\">" + std::to_string(bins[i].count) + "</text>";
    }
    svg += "<text x=\"" + text_of("%.0f", x + kWidth / 2) + "\" y=\"" + text_of("%.0f", kTop + kHeight + 13) + "\">" +
           short_number(bins[i].low) + "</text>\n";
  }
  return svg + "</svg>\n";
}

std::string histogram_text(const std::vector<HistogramBin>& bins) {
  std::size_t tallest = 1;
  for (const HistogramBin& bin : bins) tallest = std::max(tallest, bin.count);
  std::string text;
  for (const HistogramBin& bin : bins) {
    const std::size_t length = (40 * bin.count + tallest - 1) / tallest;
    char line[96];
    std::snprintf(line, sizeof line, "%8s - %-8s %-40s %zu\n", short_number(bin.low).c_str(),
                  short_number(bin.high).c_str(), std::string(length, '#').c_str(), bin.count);
    text += line;
  }
  return text;
}

}  // namespace anigen::prepare
