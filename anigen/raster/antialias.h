#pragma once
#include <cstdint>
#include <vector>

#include "anigen/raster/rasterize.h"

namespace anigen::raster {

/// Triangles at an edge, for edges with any number of them.
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

/// Pairs of neighbouring pixels between whose centres a silhouette edge passes: what antialiasing blends. In order of
/// the first pixel's row, in each row those with the right neighbour before those with the one below.
struct SilhouettePairs {
  Tensor index;  ///< [K, 4] int64: first pixel (row · W + column), 1 if the other is below else 0, the edge's vertices
  Tensor weight;  ///< [K] fp64 in [-0.5, 0.5]: times (second − first) is added to the first pixel if positive, else
                  ///< to the second
  Tensor row_begin;  ///< [H + 1] int64: where each row's pairs begin
};

/// The edge belongs to the nearer pixel's triangle and is a silhouette: no other triangle continues the surface on its
/// far side. Edges with an end behind the camera are left out (docs/reference/training.md, 8).
/// @param fragments of these positions and faces @throws InputError when they cannot be
SilhouettePairs find_silhouette_pairs(const Fragments& fragments, const Tensor& clip, const Tensor& faces);

/// Blends neighbouring pixels across silhouette edges by where the edge crosses between their centres, so that moving a
/// silhouette changes the picture continuously. Gradients reach the image and x, y, w of the vertices of those edges,
/// except where an edge passes through a centre. Several images of one view are antialiased fastest as channels of one.
/// Same result for any number of threads; differentiable once.
/// @param image [H, W, C] fp32 or fp64 @param fragments of these positions and faces @return [H, W, C]
/// (docs/reference/training.md, 8)
/// @throws InputError when shapes, types or indices do not fit
Tensor antialias(const Tensor& image, const Fragments& fragments, const Tensor& clip, const Tensor& faces);

}  // namespace anigen::raster
