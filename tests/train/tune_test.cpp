#include "anigen/train/tune.h"

#include <gtest/gtest.h>

#include <map>
#include <tuple>

namespace anigen::train {
namespace {

// Samples per second by precision, replicas and micro-batches; what is not listed fails.
using Rates = std::map<std::tuple<std::string, std::size_t, std::size_t>, double>;

std::vector<TimedSettings> search(const Rates& rates, std::vector<StepSettings>& asked, std::size_t batch_size,
                                  const std::string& failure) {
  return search_settings(batch_size, 2, {"fp32", "bf16"}, [&](const StepSettings& settings) {
    asked.push_back(settings);
    TimedSettings timed;
    timed.settings = settings;
    const auto found = rates.find({settings.precision, settings.replicas, settings.batch_split});
    if (found == rates.end()) {
      timed.failure = failure;
    } else {
      timed.samples_per_second = found->second;
    }
    return timed;
  });
}

TEST(SearchSettings, StopsWhereMoreMicroBatchesAreSlowerAndPutsTheFastestFirst) {
  std::vector<StepSettings> asked;
  const auto all = search({{{"fp32", 1, 1}, 10},
                           {{"fp32", 1, 2}, 12},
                           {{"fp32", 1, 4}, 11},
                           {{"fp32", 2, 2}, 15},
                           {{"fp32", 2, 4}, 14},
                           {{"bf16", 1, 1}, 20},
                           {{"bf16", 1, 2}, 13},
                           {{"bf16", 2, 2}, 19},
                           {{"bf16", 2, 4}, 18}},
                          asked, 8, "");
  EXPECT_EQ(asked.size(), 9u) << "never 8 micro-batches, since 4 are slower than 2";
  EXPECT_EQ(all.front().settings.precision, "bf16");
  EXPECT_EQ(all.front().settings.replicas, 1u);
  EXPECT_EQ(all.front().settings.batch_split, 1u);
}

TEST(SearchSettings, APrecisionThatTheStageLacksIsAskedOnce) {
  std::vector<StepSettings> asked;
  const auto all = search({{{"fp32", 1, 1}, 10}, {{"fp32", 1, 2}, 9}, {{"fp32", 2, 2}, 15}}, asked, 2,
                          "precision bf16 is not supported");
  std::size_t reduced = 0;
  for (const StepSettings& settings : asked) reduced += settings.precision == "bf16" ? 1 : 0;
  EXPECT_EQ(reduced, 1u);
  EXPECT_EQ(all.front().settings.replicas, 2u);
}

TEST(SearchSettings, ReplicasThatTheStageLacksAreAskedOncePerPrecision) {
  std::vector<StepSettings> asked;
  const auto all = search({{{"fp32", 1, 1}, 10}, {{"fp32", 1, 2}, 9}, {{"bf16", 1, 1}, 20}, {{"bf16", 1, 2}, 9}}, asked,
                          8, "not supported: several replicas");
  std::size_t several = 0;
  for (const StepSettings& settings : asked) several += settings.replicas > 1 ? 1 : 0;
  EXPECT_EQ(several, 2u);
  EXPECT_EQ(all.front().settings.precision, "bf16");
}

TEST(SearchSettings, SettingsThatRunOutOfMemoryAreTriedInSmallerPieces) {
  std::vector<StepSettings> asked;
  const auto all = search({{{"fp32", 1, 4}, 10}}, asked, 4, "ended by signal 9");
  EXPECT_DOUBLE_EQ(all.front().samples_per_second, 10);
  EXPECT_EQ(all.front().settings.batch_split, 4u);
}

}  // namespace
}  // namespace anigen::train
