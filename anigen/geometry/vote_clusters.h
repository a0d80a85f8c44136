#pragma once
#include <vector>

#include "anigen/geometry/vote_clustering.h"

namespace anigen::geometry {

/// The votes both of whose confidences reach the threshold, in order, with confidences filled in.
/// @throws InputError when lengths differ, or naming the vote with a number that is not finite or beyond 1e15
Votes confident_votes(const Votes& votes, float threshold);

/// Joints from labelled votes: means of the votes weighted by confidence, over (Σ confidence + 1e-8), so that a label
/// without votes lies at the origin; parents are the joints nearest to the mean parent votes, -1 where that is the
/// joint itself. Labels with fewer than `min_size` votes are dropped unless all would be.
/// @param labels [N] of confident votes, in [0, count)
GroupedSkeleton skeleton_of_clusters(const Votes& votes, const std::vector<int>& labels, std::size_t count,
                                     int min_size);

/// @throws InputError unless low ≤ value ≤ high
void require_vote_option(const char* name, double value, double low, double high);

}  // namespace anigen::geometry
