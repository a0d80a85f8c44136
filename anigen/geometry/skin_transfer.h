#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"

namespace anigen::geometry {

/// What a mesh had at its vertices, for the vertices of a mesh made from it.
struct TransferredAttributes {
  SkinWeights skin;                     ///< one row per point; no rows when there were none
  std::vector<Eigen::Vector4f> colors;  ///< one per point; empty when there were none
};

/// Skin weights and vertex colours of a mesh at points near it, such as the vertices of the same mesh after it was
/// simplified: at each point those of the nearest place on the surface, interpolated barycentrically (reference
/// flows-and-pipeline.md, 5.8, end). Runs on all threads.
/// @param skin one row per vertex of `from`, or no rows
/// @throws InputError when `from` has no faces, skin or colours have another length than its vertices, or a position is
/// not finite
TransferredAttributes transfer_attributes(const Mesh& from, const SkinWeights& skin,
                                          const std::vector<Eigen::Vector3f>& points);

}  // namespace anigen::geometry
