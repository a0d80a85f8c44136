#pragma once
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "anigen/core/atomic_file.h"
#include "anigen/core/json.h"
#include "anigen/core/progress.h"
#include "anigen/nn/torch.h"

namespace anigen {

/// Some work of a benchmark whose figures are shares of the machine's matrix-product rate.
struct TimedTask {
  std::string name;
  double flops;  ///< that the formula needs; what an implementation does twice is not counted
  std::function<void()> work;
  std::vector<double> seconds = {};  ///< of each round

  double median() const {
    std::vector<double> sorted = seconds;
    std::sort(sorted.begin(), sorted.end());
    return sorted[sorted.size() / 2];
  }
  double gflops() const { return 1e-9 * flops / median(); }
};

/// The product that the other tasks are shares of: two matrices of 2048 × 2048. Comes first in a list of tasks.
inline TimedTask product_task(torch::Dtype dtype = torch::kFloat32) {
  constexpr std::int64_t kSide = 2048;
  const torch::Tensor a = torch::randn({kSide, kSide}).to(dtype), b = torch::randn({kSide, kSide}).to(dtype);
  torch::Tensor out = torch::empty_like(a);
  const double side = static_cast<double>(kSide);
  return {dtype == torch::kFloat32 ? "product_2048" : "product_2048_bf16", 2.0 * side * side * side,
          [=]() mutable { at::mm_out(out, a, b); }};
}

/// Times all tasks in turn, round after round, so that a machine whose speed wanders treats them alike. A task that
/// takes longer than kSlowTask in the round that warms up is timed by that one alone: such are alternatives that would
/// otherwise take nearly all of the time. Says on standard error how far it is.
inline void time_in_turn(std::vector<TimedTask>& tasks, int rounds) {
  constexpr double kSlowTask = 5.0;  // seconds
  Progress progress("timing", tasks.size() * static_cast<std::size_t>(rounds + 1), "tasks");
  for (int round = -1; round < rounds; ++round) {  // the first one warms up
    for (TimedTask& task : tasks) {
      progress.note(task.name);
      progress.advance();
      if (!task.seconds.empty() && task.seconds.front() > kSlowTask) continue;
      const auto begin = std::chrono::steady_clock::now();
      task.work();
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
      if (round >= 0 || seconds > kSlowTask) task.seconds.push_back(seconds);
    }
  }
}

/// One line a task: median time, rate, share of the first task's rate, and rounds where they are fewer.
inline void print_table(const std::vector<TimedTask>& tasks) {
  std::printf("%-42s | %10s %10s %18s\n", "", "ms", "GFLOP/s", "share of product");
  for (const TimedTask& task : tasks) {
    std::printf("%-42s | %10.2f %10.1f %17.1f%%%s\n", task.name.c_str(), 1e3 * task.median(), task.gflops(),
                100.0 * task.gflops() / tasks.front().gflops(),
                task.seconds.size() < tasks.front().seconds.size() ? "  (once)" : "");
  }
}

/// In the form of Google Benchmark. @param prefix of the names, such as "blocked_attention/"
inline void write_json(const std::string& file, const std::string& executable, const std::string& prefix,
                       const std::vector<TimedTask>& tasks) {
  Json list = Json::array();
  for (const TimedTask& task : tasks) {
    const double milliseconds = 1e3 * task.median();
    list.push_back({{"name", prefix + task.name},
                    {"run_type", "iteration"},
                    {"iterations", task.seconds.size()},
                    {"real_time", milliseconds},
                    {"cpu_time", milliseconds},
                    {"time_unit", "ms"},
                    {"share_of_product", task.gflops() / tasks.front().gflops()}});
  }
  const Json json = {{"context", {{"executable", executable}}}, {"benchmarks", list}};
  write_file_atomically(file, json.dump(2) + "\n");
}

}  // namespace anigen
