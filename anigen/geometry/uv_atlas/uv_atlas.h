#pragma once
#include <Eigen/Core>
#include <cstdint>
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
/// of the texture empty, long charts are cut. Takes the place of xatlas in the published pipeline (reference
/// flows-and-pipeline.md, 5.10, step 1): the same kind of result, other charts. Vertices that no face uses are dropped.
/// A face without area has none in the texture either. Runs on all threads; the result does not depend on them.
/// @param vertices [V], any frame and unit @param faces [F]
/// @throws InputError naming an option out of range, a vertex that is not finite, a face with a bad index; without
/// faces or area; when charts are too many for the texture
UvAtlas make_uv_atlas(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                      const UvAtlasOptions& options = {});

}  // namespace anigen::geometry
