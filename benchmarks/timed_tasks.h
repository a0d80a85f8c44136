#pragma once
#include <ATen/Parallel.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/nn/torch.h"
#include "benchmarks/benchmark_flags.h"

namespace anigen {

/// First call of main(): flags, and threads, memory and random numbers as the programs have them, with a fixed seed.
/// @return nothing for wrong flags
inline std::optional<BenchmarkFlags> start_timing(int argc, char** argv) {
  const std::optional<BenchmarkFlags> flags = benchmark_flags(argc, argv);
  keep_freed_memory();
  at::set_num_threads(thread_count());
  torch::manual_seed(0);
  return flags;
}

/// Some work of a benchmark whose figures are shares of the machine's matrix-product rate.
struct TimedTask {
  std::string name;
  double flops;  ///< that the formula needs; what an implementation does twice is not counted
  std::function<void()> work;
  int reference = 0;  ///< place in the list of the product that it is a share of, in its own type; kNoReference: none
  std::function<void()> prepare = {};  ///< before each round, not timed
  std::vector<double> seconds = {};    ///< of each round

  double median() const {
    std::vector<double> sorted = seconds;
    std::sort(sorted.begin(), sorted.end());
    return sorted[sorted.size() / 2];
  }
  double gflops() const { return 1e-9 * flops / median(); }
};

inline constexpr int kNoReference = -1;

/// Share of the matrix product in the same type; empty without one.
inline std::optional<double> share_of_product(const std::vector<TimedTask>& tasks, const TimedTask& task) {
  if (task.reference == kNoReference) return std::nullopt;
  return task.gflops() / tasks[static_cast<std::size_t>(task.reference)].gflops();
}

/// The product that other tasks are shares of: two matrices of 2048 × 2048. Tasks that say nothing are shares of the
/// first of a list.
inline TimedTask product_task(torch::Dtype dtype = torch::kFloat32) {
  constexpr std::int64_t kSide = 2048;
  const torch::Tensor a = torch::randn({kSide, kSide}).to(dtype), b = torch::randn({kSide, kSide}).to(dtype);
  torch::Tensor out = torch::empty_like(a);
  const double side = static_cast<double>(kSide);
  return {dtype == torch::kFloat32 ? "product_2048" : "product_2048_bf16", 2.0 * side * side * side,
          [=]() mutable { at::mm_out(out, a, b); }};
}

/// Adds such a product for tasks of its type. @return its place, their TimedTask::reference
inline int add_product(std::vector<TimedTask>& tasks, torch::Dtype dtype) {
  tasks.push_back(product_task(dtype));
  return tasks.back().reference = static_cast<int>(tasks.size()) - 1;
}

/// Leaves the tasks whose names contain `word`, and the products that they are shares of.
inline void keep_tasks(std::vector<TimedTask>& tasks, const std::string& word) {
  std::vector<bool> kept(tasks.size(), false);
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    if (tasks[i].name.find(word) == std::string::npos) continue;
    kept[i] = true;
    if (tasks[i].reference != kNoReference) kept[static_cast<std::size_t>(tasks[i].reference)] = true;
  }
  std::vector<int> places(tasks.size(), kNoReference);
  std::vector<TimedTask> left;
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    if (!kept[i]) continue;
    places[i] = static_cast<int>(left.size());
    left.push_back(std::move(tasks[i]));
  }
  for (TimedTask& task : left) {
    if (task.reference != kNoReference) task.reference = places[static_cast<std::size_t>(task.reference)];
  }
  if (left.empty()) {
    std::fprintf(stderr, "no task has '%s' in its name\n", word.c_str());
    std::exit(2);
  }
  tasks = std::move(left);
}

/// Times all tasks in turn, round after round, so that a machine whose speed wanders treats them alike. A task that
/// takes longer than kSlowTask in the round that warms up is timed by that one alone: such are alternatives that would
/// otherwise take nearly all of the time. Says on standard error how far it is.
/// @param usual_rounds where the flags do not say how many @return the rounds there were
inline int time_in_turn(std::vector<TimedTask>& tasks, const BenchmarkFlags& flags, int usual_rounds) {
  constexpr double kSlowTask = 5.0;  // seconds
  const int rounds = flags.rounds(usual_rounds);
  keep_tasks(tasks, flags.filter);
  Progress progress("timing", tasks.size() * static_cast<std::size_t>(rounds + 1), "tasks");
  for (int round = -1; round < rounds; ++round) {  // the first one warms up
    for (TimedTask& task : tasks) {
      progress.note(task.name);
      progress.advance();
      if (!task.seconds.empty() && task.seconds.front() > kSlowTask) continue;
      if (task.prepare) task.prepare();
      const auto begin = std::chrono::steady_clock::now();
      task.work();
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
      if (round >= 0 || seconds > kSlowTask) task.seconds.push_back(seconds);
    }
  }
  return rounds;
}

/// One line a task: median time, rate, share of the product's rate, and rounds where they are fewer.
inline void print_table(const std::vector<TimedTask>& tasks) {
  std::printf("%-42s | %10s %10s %18s\n", "", "ms", "GFLOP/s", "share of product");  // in the same type
  for (const TimedTask& task : tasks) {
    const std::optional<double> share = share_of_product(tasks, task);
    char text[20] = "";
    if (share) std::snprintf(text, sizeof text, "%.1f%%", 100.0 * *share);
    std::printf("%-42s | %10.2f %10.1f %18s%s\n", task.name.c_str(), 1e3 * task.median(), task.gflops(), text,
                task.seconds.size() < tasks.front().seconds.size() ? "  (once)" : "");
  }
}

/// In the form of Google Benchmark. @param prefix of the names, such as "blocked_attention/"
inline void write_json(const std::string& file, const std::string& executable, const std::string& prefix,
                       const std::vector<TimedTask>& tasks) {
  Json list = Json::array();
  for (const TimedTask& task : tasks) {
    const double milliseconds = 1e3 * task.median();
    Json row = {{"name", prefix + task.name}, {"run_type", "iteration"},  {"iterations", task.seconds.size()},
                {"real_time", milliseconds},  {"cpu_time", milliseconds}, {"time_unit", "ms"}};
    if (const std::optional<double> share = share_of_product(tasks, task)) row["share_of_product"] = *share;
    list.push_back(std::move(row));
  }
  const Json json = {{"context", {{"executable", executable}}}, {"benchmarks", list}};
  write_file_atomically(file, json.dump(2) + "\n");
}

}  // namespace anigen
