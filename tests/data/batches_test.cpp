#include <gtest/gtest.h>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <numeric>
#include <set>
#include <thread>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/data/batches.h"

namespace anigen::data {

namespace {

using Groups = std::vector<std::vector<std::size_t>>;

TEST(BalancedGroups, HeaviestFirstToTheLightest) {
  EXPECT_EQ(balanced_groups({4, 9, 7, 1, 5}, 2), (Groups{{1, 0}, {2, 4, 3}}));
  EXPECT_EQ(balanced_groups({3, 2}, 1), (Groups{{0, 1}}));
  EXPECT_EQ(balanced_groups({2, 3}, 3), (Groups{{1}, {0}, {}}));
}

TEST(BalancedGroups, EqualSizeFillsUp) {
  // Without the limit all the small ones would go to the second group.
  EXPECT_EQ(balanced_groups({100, 1, 2, 3}, 2), (Groups{{0}, {3, 2, 1}}));
  EXPECT_EQ(balanced_groups({100, 1, 2, 3}, 2, true), (Groups{{0, 1}, {3, 2}}));
  EXPECT_THROW(balanced_groups({1, 2, 3}, 2, true), InputError);
  EXPECT_THROW(balanced_groups({1}, 0), InputError);
}

// A group that gets an item is the lightest then, so at most the mean: it ends no more than one item above it.
TEST(BalancedGroups, StaysWithinTheBound) {
  Rng rng(2, "t");
  for (int round = 0; round < 50; ++round) {
    std::vector<std::uint64_t> loads(24);
    std::uint64_t sum = 0, largest = 0;
    for (std::uint64_t& load : loads) {
      load = 1 + rng.index(30000);
      sum += load;
      largest = std::max(largest, load);
    }
    std::size_t items = 0;
    for (const auto& group : balanced_groups(loads, 4)) {
      std::uint64_t total = 0;
      for (const std::size_t i : group) total += loads[i];
      EXPECT_LE(total, sum / 4 + largest);
      items += group.size();
    }
    EXPECT_EQ(items, loads.size());
  }
}

}  // namespace

namespace {

std::vector<std::uint64_t> random_loads(std::size_t count) {
  Rng rng(1, "loads");
  std::vector<std::uint64_t> loads(count);
  for (std::uint64_t& load : loads) load = 1 + rng.index(1000);
  return loads;
}

// Mean over the batches of one training run of (largest − smallest load), batches cut from the endless stream.
double mean_spread(SampleOrder order, const std::vector<std::uint64_t>& loads, std::size_t batch, int steps,
                   double& worst) {
  double sum = 0.0;
  worst = 0.0;
  for (int step = 0; step < steps; ++step) {
    std::uint64_t low = ~std::uint64_t{0}, high = 0;
    for (const Draw& draw : order.draws(static_cast<std::uint64_t>(step) * batch, batch)) {
      low = std::min(low, loads[draw.item]);
      high = std::max(high, loads[draw.item]);
    }
    sum += static_cast<double>(high - low);
    worst = std::max(worst, static_cast<double>(high - low));
  }
  return sum / steps;
}

TEST(BucketedOrder, EveryEpochIsAPermutation) {
  for (const std::size_t items : {1u, 5u, 8u, 100u, 103u}) {
    const std::vector<std::uint64_t> loads = random_loads(items);
    std::vector<std::size_t> all(items);
    std::iota(all.begin(), all.end(), std::size_t{0});
    for (std::uint64_t epoch = 0; epoch < 12; ++epoch) {
      std::vector<std::size_t> order = bucketed_permutation(loads, 8, 3, epoch);
      EXPECT_EQ(order, bucketed_permutation(loads, 8, 3, epoch)) << "a pure function";
      std::sort(order.begin(), order.end());
      EXPECT_EQ(order, all);
    }
  }
}

TEST(BucketedOrder, BatchesHoldItemsOfSimilarLoad) {
  constexpr std::size_t kItems = 203, kBatch = 8;  // no multiple: some batches lie across two epochs
  const std::vector<std::uint64_t> loads = random_loads(kItems);
  double worst_bucketed = 0, worst_random = 0;
  const double bucketed = mean_spread(SampleOrder(loads, kBatch, 7), loads, kBatch, 200, worst_bucketed);
  const double random = mean_spread(SampleOrder(kItems, 7), loads, kBatch, 200, worst_random);
  // Uniform loads: eight random ones span 7/9 of the range. Sorted, a batch spans 4 % and the stretch of a quarter.
  EXPECT_GT(random, 700);
  EXPECT_LT(bucketed, 250);
  EXPECT_LT(worst_bucketed, 450) << "also where two epochs meet";
}

TEST(BucketedOrder, EpochsMixItemsDifferently) {
  const std::vector<std::uint64_t> loads = random_loads(64);
  std::set<std::set<std::size_t>> batches;
  for (std::uint64_t epoch = 0; epoch < 4; ++epoch) {
    const std::vector<std::size_t> order = bucketed_permutation(loads, 8, 3, epoch);
    for (std::size_t k = 0; k < 8; ++k) {
      const auto first = order.begin() + static_cast<std::ptrdiff_t>(8 * k);
      batches.insert(std::set<std::size_t>(first, first + 8));
    }
  }
  EXPECT_GT(batches.size(), 20u) << "of 32; the smallest items are too far apart to mix";
  EXPECT_NE(bucketed_permutation(loads, 8, 3, 0), bucketed_permutation(loads, 8, 4, 0));
}

TEST(BucketedOrder, AnyPlaceCanBeAskedFor) {
  const std::vector<std::uint64_t> loads = random_loads(29);
  SampleOrder order(loads, 4, 5), other(loads, 4, 5);
  const std::vector<Draw> draws = order.draws(0, 150);
  for (const std::uint64_t first : {140u, 3u, 60u}) {
    const std::vector<Draw> part = other.draws(first, 9);
    for (std::size_t i = 0; i < 9; ++i) EXPECT_EQ(part[i].item, draws[first + i].item);
  }
}

/// Tells when it is gone; loading takes a while.
class SlowSource : public BatchSource {
 public:
  explicit SlowSource(std::atomic<bool>& gone) : gone_(gone) {}
  ~SlowSource() override { gone_ = true; }
  std::size_t size() const override { return 4; }
  std::unique_ptr<Batch> load(const std::vector<Draw>&) const override {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return std::make_unique<Batch>();
  }

 private:
  std::atomic<bool>& gone_;
};

TEST(Prefetcher, KeepsItsSourceWhileThreadsReadIt) {
  std::atomic<bool> gone{false};
  auto source = std::make_shared<SlowSource>(gone);
  {
    Prefetcher loader(source, 1, 0, {2, 1, 2, 3});
    loader.next();
    source.reset();  // as a training does that takes newer shards
    EXPECT_FALSE(gone);
    EXPECT_EQ(loader.next().size(), 1U);
  }
  EXPECT_TRUE(gone);
}

}  // namespace

}  // namespace anigen::data
