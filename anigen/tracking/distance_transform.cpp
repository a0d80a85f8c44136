#include "anigen/tracking/distance_transform.h"

#include <cmath>
#include <cstddef>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::tracking {

namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();

/// Lower envelope of the parabolas (x - place)² + height over a line of pixels.
class ParabolaEnvelope {
 public:
  explicit ParabolaEnvelope(std::size_t length) : places_(length), begins_(length) {}

  /// Replaces heights, [length], by the envelope; infinite ones have no parabola.
  void apply(std::vector<double>& heights) {
    build(heights);
    if (count_ == 0) return;
    lowest_.assign(heights.size(), 0.0);
    std::size_t k = 0;
    for (std::size_t x = 0; x < heights.size(); ++x) {
      const auto here = static_cast<double>(x);
      while (k + 1 < count_ && begins_[k + 1] < here) ++k;
      const double away = here - static_cast<double>(places_[k]);
      lowest_[x] = away * away + heights[places_[k]];
    }
    heights.swap(lowest_);
  }

 private:
  void build(const std::vector<double>& heights) {
    count_ = 0;
    for (std::size_t place = 0; place < heights.size(); ++place) {
      if (heights[place] == kInfinite) continue;
      double begin = -kInfinite;
      while (count_ > 0) {
        begin = crossing(heights, places_[count_ - 1], place);
        if (begin > begins_[count_ - 1]) break;
        --count_;
        begin = -kInfinite;
      }
      places_[count_] = place;
      begins_[count_] = begin;
      ++count_;
    }
  }

  /// From there on the parabola of the right one of two places is the lower one.
  static double crossing(const std::vector<double>& heights, std::size_t left, std::size_t right) {
    const auto a = static_cast<double>(left), b = static_cast<double>(right);
    return ((heights[right] + b * b) - (heights[left] + a * a)) / (2.0 * (b - a));
  }

  std::size_t count_ = 0;
  std::vector<std::size_t> places_;  // of the parabolas that the envelope consists of, from the left
  std::vector<double> begins_;       // of their parts
  std::vector<double> lowest_;
};

}  // namespace

std::vector<double> distance_transform(const std::vector<std::uint8_t>& marked, int width, int height) {
  if (width < 0 || height < 0 || marked.size() != at(width) * at(height))
    throw InputError("", "silhouette", "its pixels do not fit its size");
  const std::size_t columns = at(width), rows = at(height);
  std::vector<double> squares(marked.size()), line(rows);
  ParabolaEnvelope down(rows), across(columns);
  for (std::size_t x = 0; x < columns; ++x) {
    for (std::size_t y = 0; y < rows; ++y) line[y] = marked[columns * y + x] != 0 ? 0.0 : kInfinite;
    down.apply(line);
    for (std::size_t y = 0; y < rows; ++y) squares[columns * y + x] = line[y];
  }
  line.resize(columns);
  for (std::size_t y = 0; y < rows; ++y) {
    double* row = squares.data() + columns * y;
    line.assign(row, row + columns);
    across.apply(line);
    for (std::size_t x = 0; x < columns; ++x) row[x] = std::sqrt(line[x]);
  }
  return squares;
}

}  // namespace anigen::tracking
