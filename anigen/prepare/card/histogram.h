#pragma once
#include <cstddef>
#include <string>
#include <vector>

namespace anigen::prepare {

struct HistogramBin {
  double low = 0, high = 0;  ///< [low, high), the last one closed
  std::size_t count = 0;
};

/// How numbers are spread: with equal bins of a round width, or, when they span more than two decades, bins at 1, 2, 5,
/// 10, 20, … @return at most `most` bins, none without values
std::vector<HistogramBin> histogram(const std::vector<double>& values, std::size_t most = 12);

struct Spread {
  double least = 0, median = 0, mean = 0, most = 0;
};
Spread spread(std::vector<double> values);  ///< zeros without values

/// An <svg> of its own: a bar per bin, its count above and its lower bound below. Empty without bins.
std::string histogram_svg(const std::vector<HistogramBin>& bins);

/// Lines "low – high  ######  count" for a code block.
std::string histogram_text(const std::vector<HistogramBin>& bins);

/// 12, 1.5, 3.2k, 1.1M
std::string short_number(double value);

}  // namespace anigen::prepare
