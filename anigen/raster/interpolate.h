#pragma once
#include "anigen/nn/torch.h"
#include "anigen/raster/mesh_renderer.h"

namespace anigen::raster {

/// The vertices that one of several workers adds to. Blocks of neighbouring vertices are dealt out in turn, so that
/// the corners of a triangle mostly belong together and a picture's part of the mesh is spread over all workers.
class VertexShare {
 public:
  /// @param shares a power of two
  VertexShare(std::int64_t index, std::int64_t shares) : index_(index), mask_(shares - 1) {}
  bool owns(std::int64_t vertex) const { return ((vertex >> kBlockBits) & mask_) == index_; }

 private:
  static constexpr int kBlockBits = 8;
  std::int64_t index_, mask_;
};

/// Adds up what `count` items (pixels, triangles) contribute to their three corners: every worker looks at all items,
/// in order, and adds only to vertices that it owns. Each vertex is therefore summed in the order of the items, by
/// whatever number of threads, without a lock and without a buffer per thread.
/// @param corners_of item → pointer to its three vertices; nullptr: contributes nothing
/// @param add called as add(item, corners, share) when the share owns at least one corner
template <typename CornersOf, typename Add>
void sum_by_vertex(std::int64_t count, const CornersOf& corners_of, const Add& add) {
  std::int64_t shares = 1;
  while (shares < at::get_num_threads()) shares *= 2;
  share_out(shares, [&](std::int64_t index) {
    const VertexShare share(index, shares);
    for (std::int64_t item = 0; item < count; ++item) {
      const std::int64_t* corners = corners_of(item);
      if (corners == nullptr) continue;
      if (share.owns(corners[0]) || share.owns(corners[1]) || share.owns(corners[2])) add(item, corners, share);
    }
  });
}

/// Unit normals (v₁ − v₀) × (v₂ − v₀) of the faces, counter-clockwise outside; (almost) zero for faces whose doubled
/// area is below 1e-12, which also pass no gradient on. Differentiable once; same gradients for any number of threads.
/// @param vertices [V, 3] fp32 or fp64 @param faces [F, 3] int64 @return [F, 3]
/// @throws InputError when shapes, types or indices do not fit
Tensor face_normals(const Tensor& vertices, const Tensor& faces);

}  // namespace anigen::raster
