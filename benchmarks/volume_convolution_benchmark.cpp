// 3³ convolutions as the sparse-structure auto-encoder has them: ours, and torch::conv3d, as shares of what the machine
// does on a large fp32 matrix product; "mixed" are ours with factors rounded to bf16 (nn/kernels/mixed_products.h). All
// are timed in turn, round after round, so that a machine whose speed wanders treats them alike; compare only figures
// of one run. Prints a table; with --benchmark_out=FILE also Google Benchmark's JSON. Other --benchmark_* flags are
// accepted and ignored.
#include <ATen/Parallel.h>

#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "anigen/nn/kernels/mixed_products.h"
#include "anigen/nn/volumes.h"
#include "benchmarks/benchmark_flags.h"
#include "benchmarks/timed_tasks.h"

namespace {

using anigen::TimedTask;
using torch::Tensor;

constexpr int kRounds = 7;

using Convolution = std::function<Tensor(const Tensor&, const Tensor&, const Tensor&)>;

struct Layer {
  std::int64_t edge, in, out;

  double forward_flops() const { return 2.0 * 27.0 * static_cast<double>(edge * edge * edge * in * out); }
  std::string name() const { return std::to_string(edge) + "^3_" + std::to_string(in) + "_to_" + std::to_string(out); }
};

Tensor library_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  return torch::conv3d(x, weight, bias, {1, 1, 1}, {1, 1, 1});
}

// Each with the memory format that suits it: as an earlier layer of its kind leaves the volume.
void add_tasks(std::vector<TimedTask>& tasks, const Layer& layer, const std::string& kind,
               const Convolution& convolution, torch::MemoryFormat format) {
  std::vector<Tensor> in{torch::randn({1, layer.in, layer.edge, layer.edge, layer.edge}).contiguous(format),
                         torch::randn({layer.out, layer.in, 3, 3, 3}), torch::randn({layer.out})};
  const auto forward = [=] { convolution(in[0], in[1], in[2]); };
  tasks.push_back({layer.name() + "/" + kind + "_forward", layer.forward_flops(), forward});
  std::vector<Tensor> leaves;
  for (const Tensor& x : in) leaves.push_back(x.detach().requires_grad_());
  const Tensor direction = torch::randn({1, layer.out, layer.edge, layer.edge, layer.edge}).contiguous(format);
  const auto training = [=] {
    torch::autograd::grad({convolution(leaves[0], leaves[1], leaves[2])}, leaves, {direction});
  };
  tasks.push_back({layer.name() + "/" + kind + "_forward_backward", 3.0 * layer.forward_flops(), training});
}

// The backward pass multiplies as the forward pass did.
Tensor mixed_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  const anigen::nn::MixedProducts scope(anigen::nn::MixedForm::kKernels);
  return anigen::nn::volume_convolution(x, weight, bias);
}

}  // namespace

int main(int argc, char** argv) {
  const std::optional<anigen::BenchmarkFlags> flags = anigen::start_timing(argc, argv);
  if (!flags) return 2;
  std::vector<TimedTask> tasks;
  tasks.push_back(anigen::product_task());  // what the others are shares of
  const anigen::nn::MixedProducts asked(anigen::nn::MixedForm::kKernels);
  const bool mixed = anigen::nn::mixed_products();  // not on a CPU that cannot
  anigen::nn::set_mixed_products(anigen::nn::MixedForm::kNone);
  for (const Layer& layer : {Layer{64, 8, 8}, Layer{32, 16, 16}, Layer{16, 48, 48}, Layer{16, 48, 128}}) {
    add_tasks(tasks, layer, "library", library_convolution, torch::MemoryFormat::Contiguous);
    add_tasks(tasks, layer, "ours", anigen::nn::volume_convolution, torch::MemoryFormat::ChannelsLast3d);
    if (mixed) add_tasks(tasks, layer, "mixed", mixed_convolution, torch::MemoryFormat::ChannelsLast3d);
  }
  const int rounds = anigen::time_in_turn(tasks, *flags, kRounds);
  std::printf("3^3 convolutions, fp32, %d threads; medians of %d rounds\n", at::get_num_threads(), rounds);
  anigen::print_table(tasks);
  if (!flags->out.empty()) anigen::write_json(flags->out, "benchmark_volume_convolution", "volume_convolution/", tasks);
  return 0;
}
