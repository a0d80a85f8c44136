#pragma once
#include <cstddef>
#include <vector>

#include "anigen/asset/skin_weights.h"

namespace anigen {

/// How far from its anchor a joint may move a vertex of a generated asset, in hops along the skeleton: 2 · max(1, ⌊J /
/// 10⌋) (reference flows-and-pipeline.md, 5.9).
int published_max_hops(std::size_t joints);

/// Drops the weights of joints that are farther than `max_hops` from the vertex' anchor and divides what is left by its
/// sum (reference flows-and-pipeline.md, 5.9): a learned decoder gives every joint some weight, so that a hand would
/// follow the other hand a little. A row with a sum of 1e-8 or less becomes weight 1 on its anchor.
/// @param hops [J][J] distances along the undirected skeleton, as geometry::hop_distances gives them
/// @param anchors [V] a joint per vertex; empty: the heaviest joint of its row, joint 0 for a row without weights
/// @throws InputError when hops is not square, anchors has another length, or a joint is out of range
SkinWeights filter_skin(const SkinWeights& skin, const std::vector<std::vector<int>>& hops, int max_hops,
                        const std::vector<int>& anchors = {});

}  // namespace anigen
