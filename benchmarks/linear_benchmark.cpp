// Linear layers of the published flows on the tokens of a 16³ grid, in every precision of `--precision`: as shares of
// what the machine does on a large matrix product, of fp32 for "fp32", of bf16 for the others. "int8" has weights of 8
// bits and rows of fp32 numbers rounded to such (nn/int8_linear.h), "int8_of_bf16" rows of bf16 numbers, as a flow with
// `--precision int8` where there are products of those. All are timed in turn, round after round; compare only figures
// of one run. Prints a table; with
// --benchmark_out=FILE also Google Benchmark's JSON. Other --benchmark_* flags are accepted and ignored.
#include <ATen/Parallel.h>

#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/nn/int8_linear.h"
#include "anigen/nn/linear.h"
#include "benchmarks/benchmark_flags.h"
#include "benchmarks/timed_tasks.h"

namespace {

using anigen::TimedTask;
using torch::Tensor;

constexpr int kRounds = 7;

struct Layer {
  std::int64_t rows, in, out;

  double flops() const { return 2.0 * static_cast<double>(rows * in * out); }
  std::string name() const {
    return std::to_string(rows) + "x" + std::to_string(in) + "_to_" + std::to_string(out) + "/";
  }
};

void add_tasks(std::vector<TimedTask>& tasks, const Layer& layer, int bf16_product) {
  const Tensor x = torch::randn({layer.rows, layer.in}), weight = 0.03 * torch::randn({layer.out, layer.in});
  const Tensor bias = torch::randn({layer.out});
  tasks.push_back({layer.name() + "fp32", layer.flops(), [=] { anigen::nn::linear(x, weight, bias); }});
  const auto rounded = std::make_shared<const anigen::nn::kernels::Int8Matrix>(
      anigen::nn::kernels::round_to_int8(weight.data_ptr<float>(), layer.out, layer.in));
  tasks.push_back(
      {layer.name() + "int8", layer.flops(), [=] { anigen::nn::int8_linear(x, *rounded, bias); }, bf16_product});
  const Tensor x16 = x.to(torch::kBFloat16), weight16 = weight.to(torch::kBFloat16), bias16 = bias.to(torch::kBFloat16);
  tasks.push_back(
      {layer.name() + "bf16", layer.flops(), [=] { anigen::nn::linear(x16, weight16, bias16); }, bf16_product});
  tasks.push_back({layer.name() + "int8_of_bf16", layer.flops(),
                   [=] { anigen::nn::int8_linear(x16, *rounded, bias16); }, bf16_product});
}

}  // namespace

int main(int argc, char** argv) {
  const std::optional<anigen::BenchmarkFlags> flags = anigen::start_timing(argc, argv);
  if (!flags) return 2;
  const torch::NoGradGuard no_grad;
  std::vector<TimedTask> tasks;
  tasks.push_back(anigen::product_task());
  const int bf16_product = anigen::add_product(tasks, torch::kBFloat16);
  for (const Layer& layer : {Layer{4096, 1024, 3072}, Layer{4096, 1024, 1024}, Layer{4096, 1024, 4096},
                             Layer{4096, 4096, 1024}, Layer{4096, 512, 2048}})
    add_tasks(tasks, layer, bf16_product);
  const int rounds = anigen::time_in_turn(tasks, *flags, kRounds);
  std::printf("linear layers, %d threads; medians of %d rounds\n", at::get_num_threads(), rounds);
  anigen::print_table(tasks);
  if (!flags->out.empty()) anigen::write_json(flags->out, "benchmark_linear", "linear/", tasks);
  return 0;
}
