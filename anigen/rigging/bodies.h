#pragma once
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"

namespace anigen::rigging {

/// One of several bodies of a mesh.
struct SeparateBody {
  Mesh mesh;                           ///< without materials
  std::vector<std::int32_t> vertices;  ///< [V of the body] in the whole mesh
};

/// Bodies of a mesh that stand apart, such as two characters in one file, from the left (least x). Connected components
/// whose bounding boxes come nearer than 5 % of the mesh's diagonal belong together; a group is a body when
/// its diagonal is at least half and its area three tenths of the largest group's, and smaller ones belong to the
/// nearest body. Vertices at one position are one. Of a mesh with more than 1,024 components, or eight bodies, nothing
/// is told.
/// @return at least two, or none: the mesh is one body
/// @throws InputError when a face refers to a missing vertex or a vertex is not finite
std::vector<SeparateBody> separate_bodies(const Mesh& mesh);

/// One skeleton of those of several bodies: a root between theirs, and their joints, named `body_1_…` and so on.
/// Joints have no axes of their own.
Skeleton joined_skeleton(const std::vector<Skeleton>& skeletons);

/// Weights of a mesh of several bodies, for joined_skeleton().
/// @param skins of each body's vertices @param skeletons those they are for @param vertices of the whole mesh
SkinWeights joined_skin(const std::vector<SeparateBody>& bodies, const std::vector<SkinWeights>& skins,
                        const std::vector<Skeleton>& skeletons, std::size_t vertices);

}  // namespace anigen::rigging
