#pragma once
#include "anigen/fields/flexicubes.h"

namespace anigen::fields {

/// How the channels of a fine voxel are laid out and turned into a mesh (reference autoencoders.md, 3.8 and 4).
///
/// Skin features of mesh vertices normally pass through FlexiCubes like colours. With `skin_interp_sparse` they are
/// taken from the eight nearest active grid vertices instead; `skin_interp_nearest` (from one), `skin_interp_trilinear`
/// (from the cell, only when deformation is off) and `skin_interp_use_deformed_grid` modify that and do nothing without
/// it. `skin_nodeform_trilinear` stands for `skin_interp_sparse`, `skin_interp_trilinear` and `disable_deform`
/// together.
struct MeshFieldOptions {
  std::int64_t resolution = 256;
  bool use_color = true;
  std::int64_t skin_channels = 4;              ///< 0: no skin feature (predict_skin off)
  bool disable_deform = false;                 ///< flexicube_disable_deform
  bool skin_interp_sparse = false;             ///< vertex_skin_feat_interp_sparse
  bool skin_interp_nearest = false;            ///< vertex_skin_feat_interp_nearest
  bool skin_interp_trilinear = false;          ///< vertex_skin_feat_interp_trilinear
  bool skin_interp_use_deformed_grid = false;  ///< vertex_skin_feat_interp_use_deformed_grid
  bool skin_nodeform_trilinear = false;        ///< vertex_skin_feat_nodeform_trilinear

  /// 8 sdf + 24 deform + 21 weights + 48 colour + 8 · skin.
  std::int64_t channels() const { return 53 + (use_color ? 48 : 0) + 8 * skin_channels; }
};

struct ExtractedMesh {
  bool success = false;  ///< whether there is a surface
  Tensor vertices;       ///< [V, 3] object space
  Tensor faces;          ///< [F, 3] int64
  Tensor attributes;     ///< [V, 6]: RGB and normal map, in [0, 1]; undefined without colour
  Tensor skin_features;  ///< [V, S]; undefined without skin
  /// The averaged field, for the TSDF loss (field.positions(), field.sdf) and inspection; attributes: skin feature,
  /// then colour. Its deformation is zero when the options disable it.
  CubeField field;
  Tensor regularizer;  ///< scalar, only when training (reference autoencoders.md, 3.11, mesh regulariser)
  struct Terms {
    Tensor consistency, deviation, weights;  ///< scalars: unweighted means, only when training
  } terms;
};

/// Channels of the fine voxels of one asset → mesh. Differentiable once in feats.
/// @param coords [C, 3] integers in [0, resolution), no voxel twice @param feats [C, options.channels()] fp32 or fp64
/// @throws InputError when shapes do not fit, or for a voxel outside the grid or twice
ExtractedMesh extract_mesh(const Tensor& coords, const Tensor& feats, const MeshFieldOptions& options, bool training);

}  // namespace anigen::fields
