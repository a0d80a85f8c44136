// Votes to skeleton: ours, with neighbours from a grid of cells, against comparing all pairs (which ends a search at
// the last neighbour it may take, too). Both on the same votes in one run; the skeletons are compared first and must be
// equal bit for bit. Compare only figures of one run.
#include <benchmark/benchmark.h>

#include <cstdio>
#include <functional>
#include <list>
#include <string>

#include "anigen/core/parallel.h"
#include "benchmarks/ratio_reporter.h"
#include "tests/skeleton_field/drawn_votes.h"
#include "tests/skeleton_field/plain_vote_clustering.h"

namespace {

using anigen::skeleton_field::GroupedSkeleton;
using anigen::skeleton_field::Votes;
using Grouping = std::function<GroupedSkeleton(const Votes&)>;

struct Case {
  std::string name;
  Votes votes;
};

void add(const std::string& method, const Case& input, int threads, int repetitions, const Grouping& body) {
  benchmark::RegisterBenchmark((method + "/" + input.name).c_str(),
                               [&input, threads, body](benchmark::State& state) {
                                 anigen::set_thread_count(threads);
                                 for (auto _ : state) benchmark::DoNotOptimize(body(input.votes));
                                 const auto count =
                                     static_cast<std::size_t>(state.iterations()) * input.votes.joints.size();
                                 state.counters["votes_per_second"] =
                                     benchmark::Counter(static_cast<double>(count), benchmark::Counter::kIsRate);
                               })
      ->UseRealTime()
      ->Unit(benchmark::kMillisecond)
      ->Repetitions(repetitions);
}

bool equal(const GroupedSkeleton& a, const GroupedSkeleton& b) {
  return a.joints == b.joints && a.parents == b.parents;
}

}  // namespace

int main(int argc, char** argv) {
  const Grouping ours = [](const Votes& votes) { return anigen::skeleton_field::mean_shift_grouping(votes); };
  const Grouping plain = [](const Votes& votes) { return anigen::test::PlainVoteClustering::mean_shift(votes, {}); };
  const Grouping ours_threshold = [](const Votes& votes) { return anigen::skeleton_field::threshold_grouping(votes); };
  const Grouping plain_threshold = [](const Votes& votes) {
    return anigen::test::PlainVoteClustering::threshold(votes, {});
  };
  std::list<Case> cases;  // registered benchmarks refer to them
  for (const std::size_t count : {5000u, 20000u, 50000u}) {
    cases.push_back({std::to_string(count) + "_votes", anigen::test::drawn_votes(count, 60, 0.004, 1)});
    const Case& input = cases.back();
    const GroupedSkeleton found = ours(input.votes);
    std::printf("%s: %zu joints; equal to all pairs: %s, by threshold: %s\n", input.name.c_str(), found.joints.size(),
                equal(found, plain(input.votes)) ? "yes" : "NO",
                equal(ours_threshold(input.votes), plain_threshold(input.votes)) ? "yes" : "NO");
    add("anigen_1", input, 1, 3, ours);
    add("anigen_2", input, 2, 3, ours);
    add("all_pairs", input, 1, 1, plain);
    add("anigen_threshold_1", input, 1, 3, ours_threshold);
    add("all_pairs_threshold", input, 1, 1, plain_threshold);
  }

  benchmark::Initialize(&argc, argv);
  anigen::benchmarks::RatioReporter reporter("votes_per_second");
  benchmark::RunSpecifiedBenchmarks(&reporter);
  std::printf("\nRatios of votes per second (fastest of the repetitions):\n");
  for (const Case& input : cases) {
    const std::string end = "/" + input.name;
    reporter.print_ratio(input.name + ": mean shift, ours over all pairs, 1 thread", "anigen_1" + end,
                         "all_pairs" + end);
    reporter.print_ratio(input.name + ": threshold, ours over all pairs, 1 thread", "anigen_threshold_1" + end,
                         "all_pairs_threshold" + end);
    reporter.print_ratio(input.name + ": mean shift, 2 threads over 1", "anigen_2" + end, "anigen_1" + end);
  }
  benchmark::Shutdown();
  return 0;
}
