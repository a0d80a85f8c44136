#include "anigen/geometry/uv_atlas/chart_packing.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/uv_atlas/chart_mask.h"
#include "anigen/geometry/uv_atlas/texel_rows.h"

namespace anigen::geometry {
namespace {

constexpr int kMostScales = 12;
constexpr double kCloseScales = 1.015;
constexpr double kFirstOccupancy = 0.7;  ///< a usual one

/// Charts in a strip of given width, filled from below.
class ChartStrip {
 public:
  ChartStrip(int width, int gutter) : taken_(width), gutter_(gutter), margin_((gutter + 1) / 2) {}

  int margin() const { return margin_; }
  int top() const { return top_; }  ///< rows in use, with the margin above them

  /// The lowest place, then the leftmost, where the mask fits between the margins. @param most only places whose top
  /// row lies below this one count
  std::optional<ChartPlace> place_for(const ChartMask& mask, int most) const {
    for (int y = margin_; y + mask.height < most; ++y) {
      if (room(y + mask.widest_row) < mask.widest) continue;
      const int x = free_column(mask, y);
      if (x >= 0) return ChartPlace{0, x, y};
    }
    return std::nullopt;
  }

  void put(const ChartMask& mask, const ChartPlace& place) {
    for (int row = 0; row < mask.height; ++row) {
      for (const ChartMask::Run* run = mask.begin(row); run != mask.end(row); ++run) {
        for (int y = place.y + row - gutter_; y <= place.y + row + gutter_; ++y) {
          taken_.take(y, place.x + run->begin - gutter_, place.x + run->end + gutter_);
        }
      }
    }
    room_.resize(std::max(room_.size(), at(place.y + mask.height + gutter_)), taken_.width());
    const int end = place.y + mask.height + gutter_;
    for (int y = std::max(place.y - gutter_, 0); y < end; ++y) room_[at(y)] = taken_.longest_free(y);
    top_ = std::max(top_, place.y + mask.height + margin_);
  }

 private:
  int room(int row) const { return at(row) < room_.size() ? room_[at(row)] : taken_.width(); }

  /// -1 without one.
  int free_column(const ChartMask& mask, int y) const {
    int x = margin_, row = 0;
    for (int clear = 0; clear < mask.height; row = row + 1 < mask.height ? row + 1 : 0) {
      if (x + mask.width > taken_.width() - margin_) return -1;
      const int moved = past_obstacle(mask, row, x, y);
      // Every row has to be looked at again from the new column.
      clear = moved == x ? clear + 1 : 0;
      x = moved;
    }
    return x;
  }

  /// The first column at or after x where the row could be free: a run that meets taken texels meets them until its
  /// begin is past the last of them.
  int past_obstacle(const ChartMask& mask, int row, int x, int y) const {
    for (const ChartMask::Run* run = mask.begin(row); run != mask.end(row); ++run) {
      const int last = taken_.last_taken(y + row, x + run->begin, x + run->end);
      if (last >= 0) return taken_.first_free(y + row, last) - run->begin;
    }
    return x;
  }

  TexelRows taken_;
  std::vector<int> room_;  ///< per row, the longest run of free texels: most rows are ruled out by it
  int gutter_, margin_, top_ = 0;
};

struct StripPacking {
  std::vector<ChartPlace> places;
  int height = 0;
  bool complete = false;  ///< false: given up where the strip became twice as high as wide
};

StripPacking pack_strip(const std::vector<PlanarChart>& charts, const std::vector<std::size_t>& order, double scale,
                        int size, int gutter) {
  constexpr int kTurns = 4;
  std::vector<std::array<std::optional<ChartMask>, kTurns>> masks(charts.size());
  parallel_for(charts.size(), [&](std::size_t c) {
    for (int turns = 0; turns < kTurns; ++turns) masks[c][at(turns)].emplace(charts[c], scale, turns);
  });
  StripPacking packing;
  packing.places.resize(charts.size());
  ChartStrip strip(size, gutter);
  for (const std::size_t c : order) {
    std::optional<ChartPlace> best;
    int best_top = 2 * size;
    for (int turns = 0; turns < kTurns; ++turns) {
      const ChartMask& mask = *masks[c][at(turns)];
      std::optional<ChartPlace> place = strip.place_for(mask, best_top);
      if (!place) continue;
      best_top = place->y + mask.height;
      place->turns = turns;
      best = place;
    }
    if (!best) {
      packing.height = 2 * size;
      return packing;
    }
    strip.put(*masks[c][at(best->turns)], *best);
    packing.places[c] = *best;
  }
  packing.height = strip.top();
  packing.complete = true;
  return packing;
}

/// The next scale to try between one that fits and one that does not; either may be unknown: 0 or infinite.
double next_scale(double tried, int height, int size, double fits, double too_large) {
  // Areas grow with the square of the scale, and heights with them.
  double next = tried * std::sqrt(static_cast<double>(size) / height);
  if (height > size) next *= 0.99;
  if (fits > 0.0 && std::isfinite(too_large)) {
    const double gap = too_large - fits;
    return next > fits + 0.15 * gap && next < too_large - 0.15 * gap ? next : fits + 0.5 * gap;
  }
  return std::isfinite(too_large) ? std::min(next, 0.97 * too_large) : std::max(next, 1.02 * fits);
}

}  // namespace

ChartPacking pack_charts(const std::vector<PlanarChart>& charts, int size, int gutter) {
  double area = 0.0, longest = 0.0;
  for (const PlanarChart& chart : charts) {
    area += chart.area;
    longest = std::max(longest, chart.extent.x());
  }
  std::vector<std::size_t> order(charts.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return charts[a].extent.x() > charts[b].extent.x(); });
  const double inside = size - 2 * ChartStrip(size, gutter).margin();

  ChartPacking best;
  double too_large = std::numeric_limits<double>::infinity();
  double scale = std::min(size * std::sqrt(kFirstOccupancy / area), inside / longest);
  for (int i = 0; i < kMostScales || best.places.empty(); ++i) {
    const StripPacking packing = pack_strip(charts, order, scale, size, gutter);
    if (packing.complete && packing.height <= size) {
      best = {scale, packing.places, area * scale * scale / (static_cast<double>(size) * size)};
      if (scale >= inside / longest) break;
    } else {
      too_large = scale;
      if (scale * longest < 1.0) {
        throw InputError("", "size",
                         std::to_string(charts.size()) + " charts with a gutter of " + std::to_string(gutter) +
                             " texels do not fit into " + std::to_string(size) + " × " + std::to_string(size) +
                             " texels, however small; take a larger texture");
      }
    }
    if (best.texels_per_unit > 0.0 && too_large < kCloseScales * best.texels_per_unit) break;
    scale = std::min(next_scale(scale, packing.height, size, best.texels_per_unit, too_large), inside / longest);
  }
  return best;
}

}  // namespace anigen::geometry
