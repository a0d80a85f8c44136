#include "anigen/geometry/uv_atlas/packing.h"

#include <array>
#include <limits>
#include <numeric>
#include <optional>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/nearest_surface.h"

namespace anigen::geometry {

namespace {

constexpr double kTexelRounding = 1e-9;  ///< a chart scaled to fill a row must not need one texel more

int texels_along(double length) { return std::max(1, static_cast<int>(std::ceil(length - kTexelRounding))); }

using RowRuns = std::vector<std::vector<ChartMask::Run>>;

/// Adds what a triangle touches: in each row, from its leftmost to its rightmost point there.
void add_triangle(const std::array<Eigen::Vector2d, 3>& corners, int width, RowRuns& rows) {
  const auto height = static_cast<int>(rows.size());
  const auto [low, high] = std::minmax({corners[0].y(), corners[1].y(), corners[2].y()});
  const int first = std::clamp(static_cast<int>(std::floor(low)), 0, height - 1);
  const int last = std::clamp(static_cast<int>(std::ceil(high)) - 1, first, height - 1);
  for (int row = first; row <= last; ++row) {
    double left = std::numeric_limits<double>::infinity(), right = -left;
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector2d &a = corners[k], &b = corners[(k + 1) % 3];
      const double rise = b.y() - a.y();
      // The part of the edge within the row, as fractions of its length.
      double from = 0.0, to = 1.0;
      if (rise != 0.0) {
        const auto [enter, leave] = std::minmax({(row - a.y()) / rise, (row + 1 - a.y()) / rise});
        from = std::max(from, enter);
        to = std::min(to, leave);
      } else if (a.y() < row || a.y() > row + 1) {
        continue;
      }
      if (from > to) continue;
      for (const double fraction : {from, to}) {
        const double x = a.x() + fraction * (b.x() - a.x());
        left = std::min(left, x);
        right = std::max(right, x);
      }
    }
    if (left > right) continue;
    const int begin = std::clamp(static_cast<int>(std::floor(left)), 0, width - 1);
    rows[at(row)].push_back({begin, std::clamp(static_cast<int>(std::ceil(right)), begin + 1, width)});
  }
}

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
        for (int y = place.y + row - gutter_; y <= place.y + row + gutter_; ++y)
          taken_.take(y, place.x + run->begin - gutter_, place.x + run->end + gutter_);
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

constexpr int kWordBits = 64;
constexpr std::uint64_t kAllBits = ~std::uint64_t{0};

/// The bits of a word that are texels of [begin, end).
std::uint64_t bits_of_word(int word, int begin, int end) {
  const int from = std::max(begin - word * kWordBits, 0), to = std::min(end - word * kWordBits, kWordBits);
  if (from >= to) return 0;
  return (kAllBits << from) & (kAllBits >> (kWordBits - to));
}

const float kTexelDiagonal = std::sqrt(2.0F);

using TexelCorners = std::array<Eigen::Vector3d, 3>;

TexelCorners corners_of(const UvAtlas& atlas, std::size_t face) {
  const Triangle& t = atlas.faces[face];
  return {texel_corner(atlas, t, 0), texel_corner(atlas, t, 1), texel_corner(atlas, t, 2)};
}

/// Calls visit(texel, distance) for the texels around a triangle whose centres are less than a diagonal away.
template <typename Wanted, typename Visit>
void for_each_texel_beside(const TexelCorners& corners, int size, Wanted&& wanted, Visit&& visit) {
  const Eigen::Vector3d low = corners[0].cwiseMin(corners[1]).cwiseMin(corners[2]);
  const Eigen::Vector3d high = corners[0].cwiseMax(corners[1]).cwiseMax(corners[2]);
  const auto texel_at = [&](double value) { return std::clamp(static_cast<int>(std::floor(value)), 0, size - 1); };
  for (int y = texel_at(low.y() - 2.0); y <= texel_at(high.y() + 2.0); ++y) {
    for (int x = texel_at(low.x() - 2.0); x <= texel_at(high.x() + 2.0); ++x) {
      const std::size_t texel = at(y) * at(size) + at(x);
      if (!wanted(texel)) continue;
      const Eigen::Vector3d centre(x + 0.5, y + 0.5, 0.0);
      const auto distance =
          static_cast<float>(nearest_on_triangle(centre, corners[0], corners[1], corners[2]).distance);
      if (distance < kTexelDiagonal) visit(texel, distance);
    }
  }
}

struct FillingLevel {
  int size;
  std::vector<char> known;
  std::vector<Eigen::Vector3f> texels;
};

/// Half the size, rounded up: means of the known ones among four.
FillingLevel coarser(const FillingLevel& fine) {
  FillingLevel coarse;
  coarse.size = (fine.size + 1) / 2;
  coarse.known.assign(at(coarse.size) * at(coarse.size), 0);
  coarse.texels.assign(coarse.known.size(), Eigen::Vector3f::Zero());
  for (int y = 0; y < coarse.size; ++y) {
    for (int x = 0; x < coarse.size; ++x) {
      Eigen::Vector3f sum = Eigen::Vector3f::Zero();
      int count = 0;
      for (int row = 2 * y; row < std::min(2 * y + 2, fine.size); ++row) {
        for (int column = 2 * x; column < std::min(2 * x + 2, fine.size); ++column) {
          const std::size_t texel = at(row) * at(fine.size) + at(column);
          if (fine.known[texel] == 0) continue;
          sum += fine.texels[texel];
          ++count;
        }
      }
      if (count == 0) continue;
      const std::size_t texel = at(y) * at(coarse.size) + at(x);
      coarse.texels[texel] = sum / static_cast<float>(count);
      coarse.known[texel] = 1;
    }
  }
  return coarse;
}

/// The coarse texels to either side of a fine one: three quarters of the one it lies in, a quarter of the other.
struct CoarseTaps {
  int near, far;
};

CoarseTaps coarse_taps(int fine, int coarse_size) {
  const int near = fine / 2, far = fine % 2 == 0 ? near - 1 : near + 1;
  return {near, std::clamp(far, 0, coarse_size - 1)};
}

void fill_from(const FillingLevel& coarse, FillingLevel& fine) {
  const auto texel = [&](int x, int y) -> const Eigen::Vector3f& {
    return coarse.texels[at(y) * at(coarse.size) + at(x)];
  };
  for (int y = 0; y < fine.size; ++y) {
    const CoarseTaps row = coarse_taps(y, coarse.size);
    for (int x = 0; x < fine.size; ++x) {
      const std::size_t index = at(y) * at(fine.size) + at(x);
      if (fine.known[index] != 0) continue;
      const CoarseTaps column = coarse_taps(x, coarse.size);
      fine.texels[index] = 0.75F * (0.75F * texel(column.near, row.near) + 0.25F * texel(column.far, row.near)) +
                           0.25F * (0.75F * texel(column.near, row.far) + 0.25F * texel(column.far, row.far));
    }
  }
}

}  // namespace

Eigen::Vector2d quarter_turned(const Eigen::Vector2d& vector, int turns) {
  const Eigen::Vector2d half = (turns & 2) != 0 ? Eigen::Vector2d(-vector) : vector;
  return (turns & 1) != 0 ? Eigen::Vector2d(-half.y(), half.x()) : half;
}

Eigen::Vector2d texel_place(const PlanarChart& flat, const Eigen::Vector2d& point, double texels_per_unit, int turns) {
  const Eigen::Vector2d corner = quarter_turned(flat.extent, turns);
  return texels_per_unit * (quarter_turned(point, turns) - corner.cwiseMin(0.0));
}

ChartMask::ChartMask(const PlanarChart& flat, double texels_per_unit, int turns) {
  const Eigen::Vector2d extent = texels_per_unit * quarter_turned(flat.extent, turns).cwiseAbs();
  width = texels_along(extent.x());
  height = texels_along(extent.y());
  std::vector<Eigen::Vector2d> places;
  for (const Eigen::Vector2d& point : flat.points) places.push_back(texel_place(flat, point, texels_per_unit, turns));
  RowRuns rows(at(height));
  for (const Triangle& t : flat.triangles)
    add_triangle({places[at(t[0])], places[at(t[1])], places[at(t[2])]}, width, rows);
  offsets.push_back(0);
  for (std::vector<Run>& row : rows) {
    std::sort(row.begin(), row.end(), [](const Run& a, const Run& b) { return a.begin < b.begin; });
    for (const Run& run : row) {
      if (runs.size() > offsets.back() && run.begin <= runs.back().end) {
        runs.back().end = std::max(runs.back().end, run.end);
      } else {
        runs.push_back(run);
      }
    }
    for (std::size_t i = offsets.back(); i < runs.size(); ++i) {
      if (runs[i].end - runs[i].begin <= widest) continue;
      widest = runs[i].end - runs[i].begin;
      widest_row = static_cast<int>(offsets.size()) - 1;
    }
    offsets.push_back(runs.size());
  }
}

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

TexelRows::TexelRows(int width) : width_(width), words_per_row_((at(width) + kWordBits - 1) / kWordBits) {}

void TexelRows::take(int row, int begin, int end) {
  begin = std::max(begin, 0);
  end = std::min(end, width_);
  if (row < 0 || begin >= end) return;
  if (row >= height()) words_.resize((at(row) + 1) * words_per_row_, 0);
  std::uint64_t* words = words_.data() + at(row) * words_per_row_;
  for (int w = begin / kWordBits; w <= (end - 1) / kWordBits; ++w) words[w] |= bits_of_word(w, begin, end);
}

int TexelRows::last_taken(int row, int begin, int end) const {
  if (row >= height() || begin >= end) return -1;
  const std::uint64_t* words = row_words(row);
  for (int w = (end - 1) / kWordBits; w >= begin / kWordBits; --w) {
    const std::uint64_t bits = words[w] & bits_of_word(w, begin, end);
    if (bits != 0) return w * kWordBits + kWordBits - 1 - __builtin_clzll(bits);
  }
  return -1;
}

int TexelRows::first_with(int row, int from, std::uint64_t flip) const {
  const std::uint64_t* words = row_words(row);
  for (int w = from / kWordBits; w * kWordBits < width_; ++w) {
    const std::uint64_t bits = (words[w] ^ flip) & bits_of_word(w, from, width_);
    if (bits != 0) return w * kWordBits + __builtin_ctzll(bits);
  }
  return width_;
}

int TexelRows::longest_free(int row) const {
  int longest = 0;
  for (int begin = first_free(row, 0), end = 0; begin < width_; begin = first_free(row, end)) {
    end = first_taken(row, begin);
    longest = std::max(longest, end - begin);
  }
  return longest;
}

std::vector<std::int32_t> texel_faces(const UvAtlas& atlas) {
  const std::size_t texels = at(atlas.size) * at(atlas.size);
  std::vector<std::int32_t> shown(texels, -1);
  for (std::size_t f = 0; f < atlas.faces.size(); ++f) {
    const TexelCorners corners = corners_of(atlas, f);
    for_each_texel_centre(corners[0].head<2>(), corners[1].head<2>(), corners[2].head<2>(), atlas.size, atlas.size,
                          [&](int x, int y) {
                            std::int32_t& face = shown[at(y) * at(atlas.size) + at(x)];
                            if (face < 0) face = static_cast<std::int32_t>(f);
                          });
  }
  // Distance of what is beside; 0 inside, where nothing can be nearer.
  std::vector<float> distances(texels);
  for (std::size_t t = 0; t < texels; ++t) distances[t] = shown[t] < 0 ? kTexelDiagonal : 0.0F;
  for (std::size_t f = 0; f < atlas.faces.size(); ++f) {
    for_each_texel_beside(
        corners_of(atlas, f), atlas.size, [&](std::size_t texel) { return distances[texel] > 0.0F; },
        [&](std::size_t texel, float distance) {
          if (distance >= distances[texel]) return;
          distances[texel] = distance;
          shown[texel] = static_cast<std::int32_t>(f);
        });
  }
  return shown;
}

void fill_unknown_texels(int size, const std::vector<char>& known, std::vector<Eigen::Vector3f>& texels) {
  std::vector<FillingLevel> levels;
  levels.push_back({size, known, std::move(texels)});
  while (levels.back().size > 1) levels.push_back(coarser(levels.back()));
  FillingLevel& top = levels.back();
  if (top.known[0] == 0) top.texels[0].setZero();
  for (std::size_t level = levels.size() - 1; level > 0; --level) fill_from(levels[level], levels[level - 1]);
  texels = std::move(levels.front().texels);
}

}  // namespace anigen::geometry
