#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/loaders/batch_source.h"

namespace anigen::loaders {

/// The endless stream of items: epoch after epoch, each a new permutation, without gaps between epochs (the
/// published loader drops an incomplete last batch instead). Position p is a pure function of (seed, p), so the
/// only state of a run is how many samples it has consumed.
class SampleOrder {
 public:
  /// @pre items > 0
  SampleOrder(std::size_t items, std::uint64_t seed);
  /// Batches of similar load, see bucketed_order.h. @param loads one per item @param batch items per step, > 0
  SampleOrder(std::vector<std::uint64_t> loads, std::size_t batch, std::uint64_t seed);

  /// Draws at positions [first, first + count).
  std::vector<Draw> draws(std::uint64_t first, std::size_t count);

 private:
  std::vector<std::size_t> permutation_of(std::uint64_t epoch) const;

  std::size_t items_, batch_ = 1;
  std::vector<std::uint64_t> loads_;  // empty: uniform permutations
  std::uint64_t seed_, epoch_ = 0;
  std::vector<std::size_t> permutation_;  // of epoch_
};

}  // namespace anigen::loaders
