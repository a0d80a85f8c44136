#include "anigen/raster/edge_neighbours.h"

#include <algorithm>

#include "anigen/raster/share_out.h"

namespace anigen::raster {
namespace {

constexpr std::int64_t kVerticesAtOnce = 4096;

}  // namespace

EdgeNeighbours::EdgeNeighbours(const std::int64_t* faces, std::int64_t face_count, std::int64_t vertex_count)
    : begin_(static_cast<std::size_t>(vertex_count) + 1, 0), sides_(static_cast<std::size_t>(3 * face_count)) {
  const auto lower_of = [&](std::int64_t face, std::int64_t k) {
    return static_cast<std::size_t>(std::min(faces[3 * face + (k + 1) % 3], faces[3 * face + (k + 2) % 3]));
  };
  // Counting sort by the lower vertex: begin_[v + 1] counts, then becomes where v's sides begin, then where they end.
  for (std::int64_t face = 0; face < face_count; ++face) {
    for (std::int64_t k = 0; k < 3; ++k) ++begin_[lower_of(face, k) + 1];
  }
  std::size_t sum = 0;
  for (std::size_t v = 1; v < begin_.size(); ++v) {
    const std::size_t count = begin_[v];
    begin_[v] = sum;
    sum += count;
  }
  for (std::int64_t face = 0; face < face_count; ++face) {
    for (std::int64_t k = 0; k < 3; ++k) {
      const std::int64_t upper = std::max(faces[3 * face + (k + 1) % 3], faces[3 * face + (k + 2) % 3]);
      sides_[begin_[lower_of(face, k) + 1]++] = {static_cast<std::int32_t>(upper),
                                                 static_cast<std::int32_t>(faces[3 * face + k]),
                                                 static_cast<std::int32_t>(face)};
    }
  }
  share_out((vertex_count + kVerticesAtOnce - 1) / kVerticesAtOnce, [&](std::int64_t part) {
    const std::int64_t end = std::min(vertex_count, (part + 1) * kVerticesAtOnce);
    for (std::int64_t v = part * kVerticesAtOnce; v < end; ++v) {
      const auto lower = static_cast<std::size_t>(v);
      if (!is_sorted(lower)) continue;
      const auto from = sides_.begin() + static_cast<std::ptrdiff_t>(begin_[lower]);
      const auto to = sides_.begin() + static_cast<std::ptrdiff_t>(begin_[lower + 1]);
      std::sort(from, to,
                [](const Side& a, const Side& b) { return a.upper != b.upper ? a.upper < b.upper : a.face < b.face; });
    }
  });
}

std::size_t EdgeNeighbours::first_side(std::size_t lower, std::int64_t upper) const {
  if (!is_sorted(lower)) return begin_[lower];
  const auto from = sides_.begin() + static_cast<std::ptrdiff_t>(begin_[lower]);
  const auto to = sides_.begin() + static_cast<std::ptrdiff_t>(begin_[lower + 1]);
  const auto found = std::lower_bound(
      from, to, upper, [](const Side& side, std::int64_t value) { return std::int64_t{side.upper} < value; });
  return static_cast<std::size_t>(found - sides_.begin());
}

}  // namespace anigen::raster
