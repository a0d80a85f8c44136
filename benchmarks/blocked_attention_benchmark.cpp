// Attention of 4096 tokens, 16 heads of 64: ours, and the plain formula, which holds every score, as shares of what the
// machine does on a large matrix product. All are timed in turn, round after round, so that a machine whose speed
// wanders treats them alike; compare only figures of one run. Prints a table; with --benchmark_out=FILE also Google
// Benchmark's JSON. Other --benchmark_* flags are accepted and ignored.
#include <ATen/Parallel.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "anigen/core/atomic_file.h"
#include "anigen/core/json.h"
#include "anigen/core/parallel.h"
#include "anigen/nn/attention.h"
#include "anigen/nn/blocked_attention.h"
#include "benchmarks/benchmark_out.h"

namespace {

using torch::Tensor;

constexpr int kRounds = 7;
constexpr std::int64_t kTokens = 4096, kHeads = 16, kChannels = 64, kSide = 2048;
constexpr std::int64_t kPlainHeads = 4;  // with all of them the plain formula's backward pass needs more than 4 GiB

using Attention = std::function<Tensor(const Tensor&, const Tensor&, const Tensor&)>;

struct Task {
  std::string name;
  double flops;  // of products that the formula needs; forming scores again is not counted
  std::function<void()> work;
  std::vector<double> seconds;

  double median() const {
    std::vector<double> sorted = seconds;
    std::sort(sorted.begin(), sorted.end());
    return sorted[sorted.size() / 2];
  }
  double gflops() const { return 1e-9 * flops / median(); }
};

// Queries, keys and values as a projection leaves them: side by side in each token's row.
std::vector<Tensor> inputs_of(std::int64_t heads, bool gradients) {
  const Tensor qkv = torch::randn({1, kTokens, 3, heads, kChannels});
  std::vector<Tensor> parts = qkv.permute({2, 0, 3, 1, 4}).unbind(0);
  for (Tensor& part : parts) part = part.detach().requires_grad_(gradients);
  return parts;
}

double forward_flops(std::int64_t heads) {
  return 4.0 * static_cast<double>(heads) * static_cast<double>(kTokens) * static_cast<double>(kTokens) *
         static_cast<double>(kChannels);
}

Task forward_task(const std::string& name, std::int64_t heads, const Attention& attention) {
  const std::vector<Tensor> in = inputs_of(heads, false);
  return {name, forward_flops(heads), [=] { attention(in[0], in[1], in[2]); }, {}};
}

Task training_task(const std::string& name, std::int64_t heads, const Attention& attention) {
  const std::vector<Tensor> in = inputs_of(heads, true);
  const Tensor direction = torch::randn({1, heads, kTokens, kChannels});
  const auto work = [=] { torch::autograd::grad({attention(in[0], in[1], in[2])}, in, {direction}); };
  return {name, 3.0 * forward_flops(heads), work, {}};
}

Task product_task() {
  const Tensor a = torch::randn({kSide, kSide}), b = torch::randn({kSide, kSide});
  Tensor out = torch::empty({kSide, kSide});
  const double side = static_cast<double>(kSide);
  return {"product_2048", 2.0 * side * side * side, [=]() mutable { at::mm_out(out, a, b); }, {}};
}

Tensor plain(const Tensor& q, const Tensor& k, const Tensor& v) { return anigen::nn::attend(q, k, v); }

void write_json(const std::string& file, const std::vector<Task>& tasks) {
  anigen::Json list = anigen::Json::array();
  for (const Task& task : tasks) {
    const double milliseconds = 1e3 * task.median();
    list.push_back({{"name", "blocked_attention/" + task.name},
                    {"run_type", "iteration"},
                    {"iterations", kRounds},
                    {"real_time", milliseconds},
                    {"cpu_time", milliseconds},
                    {"time_unit", "ms"},
                    {"share_of_product", task.gflops() / tasks.front().gflops()}});
  }
  const anigen::Json json = {{"context", {{"executable", "benchmark_blocked_attention"}}}, {"benchmarks", list}};
  anigen::write_file_atomically(file, json.dump(2) + "\n");
}

void run(std::vector<Task>& tasks) {
  for (int round = -1; round < kRounds; ++round) {  // the first one warms up
    for (Task& task : tasks) {
      const auto begin = std::chrono::steady_clock::now();
      task.work();
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
      if (round >= 0) task.seconds.push_back(seconds);
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  const std::optional<std::string> out = anigen::benchmark_out(argc, argv);
  if (!out) return 2;
  at::set_num_threads(anigen::thread_count());
  torch::manual_seed(0);
  std::vector<Task> tasks;
  tasks.push_back(product_task());  // what the others are shares of
  tasks.push_back(forward_task("plain_forward", kPlainHeads, plain));
  tasks.push_back(forward_task("blocked_forward", kHeads, anigen::nn::blocked_attention));
  tasks.push_back(training_task("plain_forward_backward", kPlainHeads, plain));
  tasks.push_back(training_task("blocked_forward_backward", kHeads, anigen::nn::blocked_attention));
  run(tasks);
  std::printf("%lld tokens, heads of %lld channels, fp32, %d threads; medians of %d rounds\n",
              static_cast<long long>(kTokens), static_cast<long long>(kChannels), at::get_num_threads(), kRounds);
  std::printf("%-26s | %10s %10s %18s\n", "", "ms", "GFLOP/s", "share of product");
  for (const Task& task : tasks) {
    std::printf("%-26s | %10.1f %10.1f %17.1f%%\n", task.name.c_str(), 1e3 * task.median(), task.gflops(),
                100.0 * task.gflops() / tasks.front().gflops());
  }
  std::printf(
      "plain: %lld heads, blocked: %lld heads; scratch of the blocked version: %.2f MiB per thread\n",
      static_cast<long long>(kPlainHeads), static_cast<long long>(kHeads),
      static_cast<double>(anigen::nn::blocked_attention_scratch_bytes(kTokens, kTokens, kChannels)) / 1048576.0);
  if (!out->empty()) write_json(*out, tasks);
  return 0;
}
