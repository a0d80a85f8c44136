// Attention of 4096 tokens, 16 heads of 64: ours, and the plain formula, which holds every score, as shares of what the
// machine does on a large matrix product. All are timed in turn, round after round, so that a machine whose speed
// wanders treats them alike; compare only figures of one run. Prints a table; with --benchmark_out=FILE also Google
// Benchmark's JSON. Other --benchmark_* flags are accepted and ignored.
#include <ATen/Parallel.h>

#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "anigen/nn/attention.h"
#include "benchmarks/benchmark_flags.h"
#include "benchmarks/timed_tasks.h"

namespace {

using anigen::TimedTask;
using torch::Tensor;

constexpr int kRounds = 7;
constexpr std::int64_t kTokens = 4096, kHeads = 16, kChannels = 64;
constexpr std::int64_t kPlainHeads = 4;  // with all of them the plain formula's backward pass needs more than 4 GiB

using Attention = std::function<Tensor(const Tensor&, const Tensor&, const Tensor&)>;

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

TimedTask forward_task(const std::string& name, std::int64_t heads, const Attention& attention) {
  const std::vector<Tensor> in = inputs_of(heads, false);
  return {name, forward_flops(heads), [=] { attention(in[0], in[1], in[2]); }};
}

TimedTask bf16_forward_task(const std::string& name, std::int64_t heads, const Attention& attention, int product) {
  std::vector<Tensor> in = inputs_of(heads, false);
  for (Tensor& part : in) part = part.to(torch::kBFloat16);
  return {name, forward_flops(heads), [=] { attention(in[0], in[1], in[2]); }, product};
}

TimedTask training_task(const std::string& name, std::int64_t heads, const Attention& attention) {
  const std::vector<Tensor> in = inputs_of(heads, true);
  const Tensor direction = torch::randn({1, heads, kTokens, kChannels});
  const auto work = [=] { torch::autograd::grad({attention(in[0], in[1], in[2])}, in, {direction}); };
  return {name, 3.0 * forward_flops(heads), work};
}

Tensor plain(const Tensor& q, const Tensor& k, const Tensor& v) { return anigen::nn::attend(q, k, v); }

}  // namespace

int main(int argc, char** argv) {
  const std::optional<anigen::BenchmarkFlags> flags = anigen::start_timing(argc, argv);
  if (!flags) return 2;
  std::vector<TimedTask> tasks;
  tasks.push_back(anigen::product_task());  // what the others are shares of
  tasks.push_back(forward_task("plain_forward", kPlainHeads, plain));
  tasks.push_back(forward_task("blocked_forward", kHeads, anigen::nn::blocked_attention));
  tasks.push_back(training_task("plain_forward_backward", kPlainHeads, plain));
  tasks.push_back(training_task("blocked_forward_backward", kHeads, anigen::nn::blocked_attention));
  const int product = anigen::add_product(tasks, torch::kBFloat16);
  tasks.push_back(bf16_forward_task("plain_forward_bf16", kPlainHeads, plain, product));
  tasks.push_back(bf16_forward_task("blocked_forward_bf16", kHeads, anigen::nn::blocked_attention, product));
  const int rounds = anigen::time_in_turn(tasks, *flags, kRounds);
  std::printf("%lld tokens, heads of %lld channels, %d threads; medians of %d rounds\n",
              static_cast<long long>(kTokens), static_cast<long long>(kChannels), at::get_num_threads(), rounds);
  anigen::print_table(tasks);
  std::printf(
      "plain: %lld heads, blocked: %lld heads; scratch of the blocked version: %.2f MiB per thread\n",
      static_cast<long long>(kPlainHeads), static_cast<long long>(kHeads),
      static_cast<double>(anigen::nn::blocked_attention_scratch_bytes(kTokens, kTokens, kChannels)) / 1048576.0);
  if (!flags->out.empty()) anigen::write_json(flags->out, "benchmark_blocked_attention", "blocked_attention/", tasks);
  return 0;
}
