#pragma once
#include <string>

#include "anigen/io/ndarray.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::io {

/// One sample dictionary of Anymate (reference anymate-baselines.md, 1.2 and 1.5). What is there is read:
///   joints [J, 3], the first joints_num of them; conns [J], a root naming itself, or the dense form [J', J''] whose
///     row is the child and whose largest entry the parent
///   bones [K, 6] head and tail, the first bones_num of them. Without joints: the unique end points, heads first;
///     without conns: the parent of a tail is its head; without bones: (joint[conn[i]], joint[i]) in increasing i
///   mesh_pc [V, 3 or 6] with mesh_face [F, 3]; else pc [N, 3 or 6], a point set
///   weights per bone of those points: mesh_skins_index/mesh_skins_weight [V, m] (−1: none) or mesh_skins [V, K];
///     skins_index/skins_weight or skins for pc
/// A bone moves with the frame at its head, so its weights go to the joint there; bones from one joint add up. The
/// links that conns has beyond the bones carry none.
/// Numbers stay in the file's frame: Y up, longest side about 2.
/// @throws InputError naming the key: wrong sizes, indices out of range, numbers that are not finite, no joint, a
/// cycle, a bone whose head is no joint (within 1e-4)
RiggedShape shape_from_anymate(const NamedArrays& sample, const std::string& id, const std::string& file);

}  // namespace anigen::io
