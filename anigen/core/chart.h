#pragma once
#include <string>
#include <utility>
#include <vector>

namespace anigen {

/// A curve as an inline <svg> of its own: axes with round ticks, the last value written at its end.
/// @param points x and y, x increasing; points that are not finite are left out
/// @return an empty string when fewer than two points are left
std::string line_chart(const std::string& title, const std::vector<std::pair<double, double>>& points);

struct Curve {
  std::string label;
  std::vector<std::pair<double, double>> points;  ///< as of line_chart()
};

/// Several curves in one picture, with a legend below. Curves of fewer than two points are left out.
std::string curves_chart(const std::string& title, const std::vector<Curve>& curves);

}  // namespace anigen
