#include "anigen/loaders/sample_order.h"

#include "anigen/core/random.h"

namespace anigen::loaders {

SampleOrder::SampleOrder(std::size_t items, std::uint64_t seed)
    : items_(items), seed_(seed), epoch_(0), permutation_(Rng(seed, "sample order", 0).permutation(items)) {}

std::vector<Draw> SampleOrder::draws(std::uint64_t first, std::size_t count) {
  std::vector<Draw> result;
  result.reserve(count);
  for (std::uint64_t position = first; position < first + count; ++position) {
    const std::uint64_t epoch = position / items_;
    if (epoch != epoch_) {
      epoch_ = epoch;
      permutation_ = Rng(seed_, "sample order", epoch).permutation(items_);
    }
    result.push_back({permutation_[position % items_], position});
  }
  return result;
}

}  // namespace anigen::loaders
