#pragma once
#include <cstddef>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/nn/torch.h"

namespace anigen::tracking {

using torch::Tensor;

/// Meshes with more vertices, after those at one place are joined, are simplified to about this many.
inline constexpr std::size_t kMostVertices = 8000;

/// A rig as tensors, in the asset's frame. Vertices that the file splits at seams of texture or shading are joined for
/// geometry, so that a seam is no silhouette edge; colours and normals keep the file's vertices.
struct RigTensors {
  std::vector<int> parents;             ///< [J], parents first
  Tensor translation, scale;            ///< [J, 3] fp64, of the bind pose, relative to the parent
  Tensor rotation;                      ///< [J, 3, 3] fp64, likewise
  Tensor unbind;                        ///< [J, 4, 4] fp64, world → joint in the bind pose
  Tensor bone_axis;                     ///< [J, 3] fp64, unit, in the joint's own axes: towards what hangs on it
  Tensor is_free;                       ///< [J, 1] fp64: 1 where a vertex hangs on the joint or below it, else 0
  Tensor vertices;                      ///< [V, 3] fp64, bind pose
  Tensor faces;                         ///< [F, 3] int64
  Tensor skin;                          ///< [V, J] fp64, rows sum to 1
  Tensor colors, normals;               ///< [C, 3] fp64: linear base colour, unit normal in the bind pose
  Tensor color_faces;                   ///< [F, 3] int64 into colours
  Tensor color_vertex;                  ///< [C] int64: the vertex that a colour lies on
  Tensor sample_faces, sample_weights;  ///< [P] int64, [P, 3] fp64: points spread evenly over the surface

  std::int64_t joints() const { return translation.size(0); }
};

/// Base colours are sampled at vertices: texture times factor times vertex colour; what a texture shows inside a face
/// is lost.
/// @throws InputError for an asset without faces, skeleton or skin, and as validate() finds
RigTensors rig_tensors(const Asset& asset);

/// Rotation matrices of rotation vectors (Rodrigues). @param turns [..., 3] radians @return [..., 3, 3]
Tensor rotations_of(const Tensor& turns);

/// World matrices (rows 0 … 2) of joints whose rotations in the bind pose are followed by turns about their own axes:
///     G_j = G_parent(j) · T_j · R_j exp(ω_j) · S_j,   the root moved by `shift` first.
/// Differentiable once in both.
/// @param turns ω [N, J, 3] radians @param shift [N, 3] world @return [N, J, 3, 4]
Tensor joint_matrices(const RigTensors& rig, const Tensor& turns, const Tensor& shift);

struct PosedRig {
  Tensor vertices;  ///< [N, V, 3]
  Tensor normals;   ///< [N, C, 3] unit, without gradient
};

/// Linear blend skinning: v' = Σ_j w_vj G_j B_j⁻¹ v. @param turns, shift as joint_matrices()
PosedRig posed(const RigTensors& rig, const Tensor& turns, const Tensor& shift);

/// Points of the surface in poses. @param vertices [V, 3] @return [P, 3]
Tensor surface_samples(const RigTensors& rig, const Tensor& vertices);

}  // namespace anigen::tracking
