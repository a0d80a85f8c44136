#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/core/config.h"

namespace anigen {

/// Share of a shell's weight in one joint from which on it counts as a rigid part (docs/rigging.md).
inline constexpr double kRigidShare = 0.7;

/// A shell and the joint that has most of its weight.
struct RigidPart {
  std::size_t vertices = 0;  ///< of the shell
  double area = 0.0;         ///< of its faces, as a part of the mesh's
  std::int32_t joint = 0;
  double share = 0.0;  ///< of the shell's weight in this joint, in [0, 1]
  bool rigid = false;  ///< it follows the joint alone now
};

struct RigidSkin {
  SkinWeights skin;
  std::vector<RigidPart> parts;  ///< every shell, in the order of mesh_shells()

  /// "12 of 15 shells rigid, 83 % of the surface"
  std::string note() const;
  /// [{"joint", "share", "vertices", "area", "rigid"}]
  Json to_json(const Skeleton& skeleton) const;
};

/// Weights under which rigid parts stay rigid. The paper's rigs bend objects of metal, because a smooth field of
/// weights knows no parts. A shell (mesh_shells()) is one part: where one joint has at least `least_share` of its
/// weight, every vertex of it follows that joint alone; the other shells keep their weights. A vertex counts by a third
/// of the area of the faces at it, so that a fine mesh has no more to say than a coarse one; where a shell has no area,
/// its vertices count alike. Vertices without faces keep their weights.
/// @param skin one row per vertex @param least_share in (0.5, 1]: above a half no two joints can have it
/// @throws InputError for a share out of range, rows that are not one per vertex, or a face of a missing vertex
RigidSkin rigid_parts(const Mesh& mesh, const SkinWeights& skin, double least_share = kRigidShare);

}  // namespace anigen
