#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/asset/asset.h"

namespace anigen::prepare {

/// The embedded procedural dataset: rigged, skinned, coloured and animated creatures, plants and machines made from
/// random numbers. datasets/creatures.md is the recipe. Every asset is
///  - one closed two-manifold mesh (2 to 8 thousand vertices) with unit normals and linear vertex colours,
///  - a skeleton of 4 to 60 named joints, joint 0 the root (hips, pelvis or base), parents before children,
///  - ground-truth skin weights of at most 8 influences per vertex,
///  - one looping idle animation, one untextured material,
/// in the normalised frame: right-handed, Z up, facing -Y, its left side towards +X, bounding box centred in
/// [-0.5, 0.5]³ with longest side 1.
///
/// The result is a function of the arguments alone: no thread count, order of calls or earlier draw matters. One call
/// runs on the calling thread; parallelise over indices. Safe to call from several threads.

/// Names of all families, in a fixed order.
const std::vector<std::string>& creature_families();

/// The family that make_creature(seed, index) draws.
const std::string& creature_family(std::uint64_t seed, std::uint64_t index);

/// One creature; its family is drawn from the stream, uniformly.
Asset make_creature(std::uint64_t seed, std::uint64_t index);

/// One creature of a family.
/// @throws InputError when the family is unknown; the message lists the known ones
Asset make_creature(const std::string& family, std::uint64_t seed, std::uint64_t index);

}  // namespace anigen::prepare
