// Peak rates of this machine, for the benchmarks that are shares of it: matrix products in fp32 and bf16, and
// copying memory, on one thread and on all. Prints a table; with --benchmark_out=FILE also Google Benchmark's JSON.
#include <ATen/Parallel.h>

#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "anigen/core/parallel.h"
#include "benchmarks/benchmark_flags.h"
#include "benchmarks/timed_tasks.h"

namespace {

using anigen::TimedTask;

constexpr int kRounds = 7;
constexpr std::int64_t kCopiedBytes = std::int64_t{1} << 28;  // far more than caches hold

// Counts bytes read and written in place of FLOP.
TimedTask copy_task() {
  const torch::Tensor from = torch::zeros({kCopiedBytes}, torch::kUInt8), to = torch::zeros_like(from);
  return {"copy", 2.0 * static_cast<double>(kCopiedBytes), [=] {
            at::parallel_for(0, kCopiedBytes, 1 << 20, [&](std::int64_t begin, std::int64_t end) {
              std::memcpy(to.data_ptr<std::uint8_t>() + begin, from.data_ptr<std::uint8_t>() + begin,
                          static_cast<std::size_t>(end - begin));
            });
          }};
}

TimedTask on_threads(TimedTask task, int threads) {
  task.reference = anigen::kNoReference;  // these are what others are shares of
  task.name += threads == 1 ? "_1_thread" : "_" + std::to_string(threads) + "_threads";
  // Threads that were just started share a core for the first milliseconds.
  task.prepare = [work = task.work, threads] {
    if (at::get_num_threads() == threads) return;
    at::set_num_threads(threads);
    work();
  };
  return task;
}

}  // namespace

int main(int argc, char** argv) {
  const std::optional<anigen::BenchmarkFlags> flags = anigen::start_timing(argc, argv);
  if (!flags) return 2;
  const int all = anigen::thread_count();
  std::vector<TimedTask> tasks;
  for (int threads = all; threads > 0; threads = threads > 1 ? 1 : 0) {
    tasks.push_back(on_threads(anigen::product_task(), threads));
    tasks.push_back(on_threads(anigen::product_task(torch::kBFloat16), threads));
    tasks.push_back(on_threads(copy_task(), threads));
  }
  const int rounds = anigen::time_in_turn(tasks, *flags, kRounds);
  std::printf("%d threads; medians of %d rounds; of copies GB/s, read and written, in place of GFLOP/s\n", all, rounds);
  anigen::print_table(tasks);
  if (!flags->out.empty()) anigen::write_json(flags->out, "benchmark_machine", "machine/", tasks);
  return 0;
}
