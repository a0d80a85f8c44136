#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace anigen::loaders {

/// A permutation of the items for one epoch whose batches hold items of similar load, so that no batch mixes a few
/// large items with many small ones. Loads are stretched by a random factor of up to a quarter before they are sorted,
/// so that batches differ between epochs; batches and the items inside each come in random order. Ours; the published
/// trainer has no buckets. A pure function of its arguments.
///
/// Batches are cut from the endless stream of draws: batch k is positions [k·batch, (k+1)·batch). Where an epoch is no
/// multiple of the batch, its last items and the first of the next epoch share a batch and are taken from the same
/// quantile of their epochs.
/// @param loads one per item, not empty @param batch items per training step, at least 1
std::vector<std::size_t> bucketed_permutation(const std::vector<std::uint64_t>& loads, std::size_t batch,
                                              std::uint64_t seed, std::uint64_t epoch);

}  // namespace anigen::loaders
