#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {

struct UvAtlasOptions {
  int size = 1024;  ///< texels along a side of the texture, 16 to 8192
  int gutter = 2;   ///< free texels between charts, 1 to 64 and size / 4; with 2 no bilinear lookup mixes two charts
  /// Degrees between a face and the plane it is projected to, 1 to 80; below 45 a right-angled edge is always a seam.
  double max_deviation = 40;
};

/// The plane of a chart: where one goes on it, in the mesh's frame and unit, by one texel of the texture.
struct AtlasChart {
  Eigen::Vector3d right;  ///< u grows
  Eigen::Vector3d down;   ///< v grows
};

/// A mesh with texture coordinates: vertices are split where charts meet.
struct UvAtlas {
  std::vector<std::int32_t> vertices;     ///< per vertex of the atlas, the vertex of the mesh that it is
  std::vector<Eigen::Vector2f> uvs;       ///< per vertex of the atlas, in [0, 1]²; glTF: the origin is the top left
  std::vector<Triangle> faces;            ///< into `vertices`; the faces of the mesh, in their order
  std::vector<std::int32_t> face_charts;  ///< per face, index into `charts`
  std::vector<AtlasChart> charts;
  int size = 0;                  ///< texels along a side that it was packed for
  double texels_per_unit = 0.0;  ///< of a face parallel to its chart's plane
  double occupancy = 0.0;        ///< part of the texture that lies in charts
  double stretch = 1.0;          ///< largest ratio of lengths on the surface to lengths in the plane over all faces
};

/// Unwraps a mesh for a texture of size × size texels. Charts are connected patches none of whose faces turns from a
/// common plane by more than max_deviation (so no length shrinks by more than 1 / cos of it), projected orthogonally,
/// not mirrored, at one scale for all, and free of overlaps wider than a quarter of a texel; where that leaves much
/// of the texture empty, long charts are cut. Takes the place of xatlas in the published pipeline
/// (docs/reference/flows.md, 5.8): the same kind of result, other charts. Vertices that no face uses are dropped. A
/// face without area has none in the texture either. Runs on all threads; the result does not depend on them.
/// @param vertices [V], any frame and unit @param faces [F]
/// @throws InputError naming an option out of range, a vertex that is not finite, a face with a bad index; without
/// faces or area; when charts are too many for the texture
UvAtlas make_uv_atlas(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                      const UvAtlasOptions& options = {});

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
/// Takes the place of the published optimisation (docs/reference/flows.md, 5.8), which fits the texture in 500 steps to
/// 100 pictures of the same dense mesh: here its colours are read, not fitted, so hidden places have theirs, too, and
/// black is a colour as any other. Runs on all threads; the result does not depend on them. About 20 bytes per texel.
/// @param atlas of the mesh that gets the texture @param vertices of that mesh
/// @param colored the dense mesh in the same frame, with vertex colours (linear RGB; alpha is ignored)
/// @throws InputError without colours or faces, naming a colour or vertex that is not finite, on an atlas of another
/// mesh or with a size or supersampling out of range
LinearTexture bake_texture(const UvAtlas& atlas, const std::vector<Eigen::Vector3f>& vertices, const Mesh& colored,
                           const TextureBakingOptions& options = {});

}  // namespace anigen::geometry
