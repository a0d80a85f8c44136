#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/uv_atlas/uv_atlas.h"

namespace anigen::geometry {

/// A square colour texture in linear light.
struct LinearTexture {
  int size = 0;                         ///< texels along a side
  std::vector<Eigen::Vector3f> texels;  ///< [size · size] RGB, rows from top to bottom
};

struct TextureBakingOptions {
  int supersampling = 1;  ///< samples along a side of a texel, which are averaged; 1 to 8
  /// Rows of the texture done so far; never from two threads at once.
  std::function<void(std::size_t done, std::size_t rows)> progress = nullptr;
};

/// The colours of a dense mesh as a texture of another mesh of the same shape, such as its simplification: every texel
/// of a chart, and every texel beside one that bilinear lookups within the chart touch, takes the colour that vertices
/// interpolate to at the dense mesh's point nearest to the texel's place. Where that point faces away, as the back of
/// something thin does, a point about as near that faces the same way is preferred. The rest of the texture is filled
/// smoothly, so that smaller mip levels do not mix in a background.
/// Takes the place of the published optimisation (reference flows-and-pipeline.md, 5.10, steps 2–5), which fits the
/// texture in 500 steps to 100 pictures of the same dense mesh: here its colours are read, not fitted, so hidden places
/// have theirs, too, and black is a colour as any other. Runs on all threads; the result does not depend on them. About
/// 20 bytes per texel.
/// @param atlas of the mesh that gets the texture @param vertices of that mesh
/// @param colored the dense mesh in the same frame, with vertex colours (linear RGB; alpha is ignored)
/// @throws InputError without colours or faces, naming a colour or vertex that is not finite, on an atlas of another
/// mesh or with a size or supersampling out of range
LinearTexture bake_texture(const UvAtlas& atlas, const std::vector<Eigen::Vector3f>& vertices, const Mesh& colored,
                           const TextureBakingOptions& options = {});

}  // namespace anigen::geometry
