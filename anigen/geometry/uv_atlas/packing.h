#pragma once
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "anigen/geometry/uv_atlas/charts.h"
#include "anigen/geometry/uv_atlas/uv_atlas.h"

namespace anigen::geometry {

/// A vector turned counter-clockwise by quarter turns.
Eigen::Vector2d quarter_turned(const Eigen::Vector2d& vector, int turns);

/// Position of a point of a flat chart, in texels, when the chart is scaled and turned within its box, whose
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

/// Position of a chart in the square: turned, then moved by whole texels.
struct ChartPlace {
  int turns = 0;     ///< quarter turns, counter-clockwise
  int x = 0, y = 0;  ///< of the lower left corner of the chart's box, in texels from that of the square
};

struct ChartPacking {
  double texels_per_unit = 0.0;    ///< the same for all charts
  std::vector<ChartPlace> places;  ///< one per chart
  double occupancy = 0.0;          ///< area of the charts over that of the square
};

/// Places charts in a square of texels, as large as they can all be: from the longest to the shortest each takes the
/// lowest place, then the leftmost, where its shape is free, in whichever of four orientations it ends lowest; the
/// scale is searched until it is within one and a half percent of one that does not fit. Between the texels that two
/// charts touch there are at least `gutter` others, and half as many, rounded up, along the sides of the square.
/// @param size texels along a side @throws InputError when the charts are too many even for the smallest scale
ChartPacking pack_charts(const std::vector<PlanarChart>& charts, int size, int gutter);

/// Calls visit(x, y) for every texel of [0, width) × [0, height) whose centre (x + ½, y + ½) lies in the triangle,
/// whichever way it runs. Triangles that share an edge, with the same numbers at both ends, share no centre and leave
/// none out: each row is cut at edges computed from their lower to their upper end, and takes what is at or right of
/// the first cut and left of the second.
template <typename Visit>
void for_each_texel_centre(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c, int width,
                           int height, Visit&& visit) {
  const Eigen::Vector2d* corners[4] = {&a, &b, &c, &a};
  const double low = std::min({a.y(), b.y(), c.y()}), high = std::max({a.y(), b.y(), c.y()});
  const auto first_centre = [](double value, int limit) {  // the first i ≥ 0 with i + ½ ≥ value
    return static_cast<int>(std::clamp(std::ceil(value - 0.5), 0.0, static_cast<double>(limit)));
  };
  const int end = first_centre(high, height);
  for (int y = first_centre(low, height); y < end; ++y) {
    const double centre = y + 0.5;
    double cuts[2] = {0.0, 0.0};
    int count = 0;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector2d *from = corners[k], *to = corners[k + 1];
      if (from->y() > to->y()) std::swap(from, to);
      if (!(from->y() <= centre && centre < to->y()) || count == 2) continue;
      cuts[count++] = from->x() + (to->x() - from->x()) * ((centre - from->y()) / (to->y() - from->y()));
    }
    if (count < 2) continue;
    const int last = first_centre(std::max(cuts[0], cuts[1]), width);
    for (int x = first_centre(std::min(cuts[0], cuts[1]), width); x < last; ++x) visit(x, y);
  }
}

/// Rows of texels that are free or taken, a bit each; rows beyond the last one are free and come into being when
/// something is put there.
class TexelRows {
 public:
  explicit TexelRows(int width);

  int width() const { return width_; }
  int height() const { return static_cast<int>(words_.size() / words_per_row_); }  ///< rows that have been touched

  /// Takes the texels [begin, end) of a row; what lies outside the rows is left out.
  void take(int row, int begin, int end);
  /// The last taken texel in [begin, end) ⊂ [0, width), -1 without one.
  int last_taken(int row, int begin, int end) const;
  /// The first taken texel at or after `from`, width() without one.
  int first_taken(int row, int from) const {
    return row >= height() || from >= width_ ? width_ : first_with(row, from, 0);
  }
  /// The first free texel at or after `from`, width() without one.
  int first_free(int row, int from) const {
    return row >= height() || from >= width_ ? std::min(from, width_) : first_with(row, from, ~std::uint64_t{0});
  }
  /// Length of the longest run of free texels.
  int longest_free(int row) const;

 private:
  /// The first texel at or after `from` whose bit, after flipping those in `flip`, is set.
  int first_with(int row, int from, std::uint64_t flip) const;
  const std::uint64_t* row_words(int row) const {
    return words_.data() + static_cast<std::size_t>(row) * words_per_row_;
  }

  int width_;
  std::size_t words_per_row_;
  std::vector<std::uint64_t> words_;
};

/// Face of the atlas that a texel shows, [size · size], rows from top to bottom: the face that its centre lies in; for
/// a centre outside all of them but less than a texel's diagonal away from one, which a bilinear lookup on that face
/// can touch, the nearest; else -1. Equally near faces, or faces that overlap, give the lowest number.
std::vector<std::int32_t> texel_faces(const UvAtlas& atlas);

/// Corner k of an atlas face in texels from the top left corner of the texture; z is 0.
inline Eigen::Vector3d texel_corner(const UvAtlas& atlas, const Triangle& face, std::size_t k) {
  const Eigen::Vector2f& uv = atlas.uvs[static_cast<std::size_t>(face[k])];
  return {static_cast<double>(uv.x()) * atlas.size, static_cast<double>(uv.y()) * atlas.size, 0.0};
}

/// Gives the texels without a colour one that changes smoothly from those around (push and pull over a pyramid of
/// means, Gortler et al. 1996, section 3.4); texels with a colour keep it. Black when none has one.
/// @param known per texel, 0 for those to fill @param texels [size · size]
void fill_unknown_texels(int size, const std::vector<char>& known, std::vector<Eigen::Vector3f>& texels);

}  // namespace anigen::geometry
