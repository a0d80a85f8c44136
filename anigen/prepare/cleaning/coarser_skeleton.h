#pragma once
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/asset.h"
#include "anigen/prepare/cleaning/cleaning.h"

namespace anigen::prepare {

/// Which joints of a skeleton a coarser rig of `wanted` joints keeps: those without weights go first, then, one at a
/// time, the joint nearest to its parent among what is left, as somebody with fewer joints to spend would leave out
/// the twist helper before the elbow. The root always stays.
/// @param weighted [J] whether a joint has weights
/// @param wanted 1 … J; more keeps everything
/// @return [J] for remove_joints(): the joint itself, or its nearest ancestor that stays
std::vector<int> coarser_heirs(const Skeleton& skeleton, const std::vector<char>& weighted, std::size_t wanted);

/// Leaves the asset a share of its joints, at least two, the share being drawn for its name from
/// [share.least, share.most] uniformly. A dataset prepared so holds like shapes with rigs of different density, which
/// is what a flow conditioned on the number of joints (paper, section 4.2; reference training-and-data.md, stage 5) has
/// to see: where every shape has its one density, the number of joints says nothing that the picture does not.
/// @return what was taken away, if anything
std::optional<CleaningFinding> coarsen_skeleton(Asset& asset, const ShareRange& share, const std::string& name);

}  // namespace anigen::prepare
