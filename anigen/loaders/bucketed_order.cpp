#include "anigen/loaders/bucketed_order.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "anigen/core/random.h"

namespace anigen::loaders {
namespace {

constexpr double kStretch = 0.25;

std::vector<std::size_t> by_stretched_load(const std::vector<std::uint64_t>& loads, Rng& rng) {
  std::vector<double> key(loads.size());
  for (std::size_t i = 0; i < loads.size(); ++i)
    key[i] = static_cast<double>(loads[i]) * (1.0 + kStretch * rng.uniform());
  std::vector<std::size_t> order = rng.permutation(loads.size());  // equal keys: in random order
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return key[a] < key[b]; });
  return order;
}

// Where among `blocks` full batches, sorted by load, the batch shared by the epochs e − 1 and e lies.
std::size_t boundary(std::uint64_t seed, std::uint64_t epoch, std::size_t blocks) {
  const double quantile = Rng(seed, "bucket boundary", epoch).uniform();
  return static_cast<std::size_t>(quantile * static_cast<double>(blocks + 1));
}

}  // namespace

std::vector<std::size_t> bucketed_permutation(const std::vector<std::uint64_t>& loads, std::size_t batch,
                                              std::uint64_t seed, std::uint64_t epoch) {
  const std::size_t items = loads.size();
  Rng rng(seed, "bucketed order", epoch);
  const std::vector<std::size_t> sorted = by_stretched_load(loads, rng);
  const std::size_t begun = static_cast<std::size_t>(epoch % batch) * (items % batch) % batch;
  const std::size_t head = begun == 0 ? 0 : std::min(items, batch - begun);
  const std::size_t full = (items - head) / batch, tail = (items - head) % batch;
  const std::size_t head_at = boundary(seed, epoch, full), tail_at = boundary(seed, epoch + 1, full);

  std::vector<std::size_t> first, last;
  std::vector<std::vector<std::size_t>> batches;
  auto next = sorted.begin();
  const auto cut = [&](std::size_t count) {
    std::vector<std::size_t> run(next, next + static_cast<std::ptrdiff_t>(count));
    next += static_cast<std::ptrdiff_t>(count);
    std::vector<std::size_t> shuffled;
    for (const std::size_t i : rng.permutation(count)) shuffled.push_back(run[i]);
    return shuffled;
  };
  for (std::size_t k = 0; k <= full; ++k) {
    if (k == head_at) first = cut(head);
    if (k == tail_at) last = cut(tail);
    if (k < full) batches.push_back(cut(batch));
  }
  std::vector<std::size_t> result = std::move(first);
  for (const std::size_t k : rng.permutation(full)) result.insert(result.end(), batches[k].begin(), batches[k].end());
  result.insert(result.end(), last.begin(), last.end());
  return result;
}

}  // namespace anigen::loaders
