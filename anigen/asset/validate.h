#pragma once
#include <string>
#include <vector>

#include "anigen/asset/asset.h"

namespace anigen {

/// Everything wrong with an asset, one sentence each, naming the array and index; empty when it is sound. Checks
/// array lengths, index ranges, finiteness, the tree (one root first, parents before children, unique names),
/// invertible bind matrices, weight rows (sum, order, repeated joints), animations (times increase, sizes) and
/// image references. Never throws and never reads out of range, whatever it is given.
/// @param at_most stop after this many findings of one kind; the last one says how many more there were
/// @param require_rig false: parts may be missing, as long as there is a mesh or a skeleton: a mesh without skeleton
/// and weights is sound, too, a skeleton without mesh, the two without weights, and points without faces
std::vector<std::string> validate(const Asset& asset, std::size_t at_most = 3, bool require_rig = true);

}  // namespace anigen
