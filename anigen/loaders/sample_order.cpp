#include "anigen/loaders/sample_order.h"

#include <utility>

#include "anigen/core/random.h"
#include "anigen/loaders/bucketed_order.h"

namespace anigen::loaders {

SampleOrder::SampleOrder(std::size_t items, std::uint64_t seed)
    : items_(items), seed_(seed), permutation_(permutation_of(0)) {}

SampleOrder::SampleOrder(std::vector<std::uint64_t> loads, std::size_t batch, std::uint64_t seed)
    : items_(loads.size()), batch_(batch), loads_(std::move(loads)), seed_(seed), permutation_(permutation_of(0)) {}

std::vector<std::size_t> SampleOrder::permutation_of(std::uint64_t epoch) const {
  if (!loads_.empty()) return bucketed_permutation(loads_, batch_, seed_, epoch);
  return Rng(seed_, "sample order", epoch).permutation(items_);
}

std::vector<Draw> SampleOrder::draws(std::uint64_t first, std::size_t count) {
  std::vector<Draw> result;
  result.reserve(count);
  for (std::uint64_t position = first; position < first + count; ++position) {
    const std::uint64_t epoch = position / items_;
    if (epoch != epoch_) {
      epoch_ = epoch;
      permutation_ = permutation_of(epoch);
    }
    result.push_back({permutation_[position % items_], position});
  }
  return result;
}

}  // namespace anigen::loaders
