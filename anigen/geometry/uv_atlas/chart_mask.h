#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "anigen/geometry/uv_atlas/planar_chart.h"

namespace anigen::geometry {

/// A vector turned counter-clockwise by quarter turns.
Eigen::Vector2d quarter_turned(const Eigen::Vector2d& vector, int turns);

/// Where a point of a flat chart comes to lie, in texels, when the chart is scaled and turned within its box, whose
/// lower left corner stays at the origin.
Eigen::Vector2d texel_place(const PlanarChart& flat, const Eigen::Vector2d& point, double texels_per_unit, int turns);

/// The texels that a scaled and turned chart touches, also where it only passes through a corner of one; at least one.
struct ChartMask {
  /// Texels [begin, end) of a row.
  struct Run {
    int begin, end;
  };
  ChartMask(const PlanarChart& flat, double texels_per_unit, int turns);

  const Run* begin(int row) const { return runs.data() + offsets[static_cast<std::size_t>(row)]; }
  const Run* end(int row) const { return runs.data() + offsets[static_cast<std::size_t>(row) + 1]; }

  int width = 1, height = 1;
  std::vector<std::size_t> offsets;  ///< [height + 1]
  std::vector<Run> runs;             ///< of a row ascending and apart; rows from the lowest
  int widest_row = 0, widest = 0;    ///< the row with the longest run, and its length
};

}  // namespace anigen::geometry
