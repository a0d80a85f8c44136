#pragma once
#include <cstdint>
#include <vector>

namespace anigen::raster {

/// Which triangles lie at an edge, for edges with any number of them.
class EdgeNeighbours {
 public:
  /// @param faces [F, 3], valid; fewer than 2³¹ of each
  EdgeNeighbours(const std::int64_t* faces, std::int64_t face_count, std::int64_t vertex_count);

  /// Calls visit(vertex) with the third corner of every triangle at the edge between a and b except `own`.
  template <typename Visit>
  void visit_others(std::int64_t a, std::int64_t b, std::int64_t own, const Visit& visit) const {
    const auto lower = static_cast<std::size_t>(a < b ? a : b);
    const std::int64_t upper = a < b ? b : a;
    for (std::size_t i = first_side(lower, upper); i < begin_[lower + 1]; ++i) {
      if (sides_[i].upper == upper && sides_[i].face != own) visit(std::int64_t{sides_[i].opposite});
      if (sides_[i].upper > upper && is_sorted(lower)) break;
    }
  }

 private:
  // A triangle's side, filed under the lower of its two vertices.
  struct Side {
    std::int32_t upper, opposite, face;
  };
  static constexpr std::size_t kFewSides = 32;  // looked through one by one

  bool is_sorted(std::size_t lower) const { return begin_[lower + 1] - begin_[lower] > kFewSides; }
  std::size_t first_side(std::size_t lower, std::int64_t upper) const;  ///< where to begin to look

  std::vector<std::size_t> begin_;  // [V + 1]
  std::vector<Side> sides_;         // [3 F]; of vertices with many by their upper vertex
};

}  // namespace anigen::raster
