// A sparse 3×3×3 convolution on shells of voxels as surfaces have them, forward and with its backward pass, as shares
// of what the machine does on a large matrix product, counting only products of voxels that exist; how it grows with
// the number of voxels; the dense convolution of the whole 64³ grid, which does the same for any of these shells (its
// own products are counted); and the convolution at twice the resolution that starts the up-sampling blocks, with
// features repeated and without. All tasks are timed in turn, round after round, so that a machine whose speed wanders
// treats them alike; compare only figures of one run. Prints a table; with --benchmark_out=FILE also Google Benchmark's
// JSON. Other
// --benchmark_* flags are accepted and ignored.
#include <ATen/Parallel.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/sparse/blocks.h"
#include "anigen/sparse/convolution.h"
#include "benchmarks/benchmark_flags.h"
#include "benchmarks/timed_tasks.h"

namespace {

using anigen::TimedTask;
using anigen::sparse::SupportPtr;
using torch::Tensor;

constexpr int kRounds = 5;
constexpr std::int64_t kGrid = 64;
constexpr std::int64_t kVoxels[] = {2048, 8192, 32768, 65536};
constexpr std::int64_t kWidths[] = {64, 128};
constexpr std::int64_t kCoarseVoxels = 8192;  // of the up-sampling, to eight times as many

// So many voxels nearest to a sphere; thicker than one voxel where the grid is too small for a thin shell of as many.
SupportPtr shell_of(std::int64_t voxels) {
  const double middle = 0.5 * static_cast<double>(kGrid - 1), pi = std::acos(-1.0);
  const double radius = std::min(0.4 * static_cast<double>(kGrid), std::sqrt(static_cast<double>(voxels) / (4.0 * pi)));
  std::vector<std::pair<double, std::int64_t>> cells;
  for (std::int64_t cell = 0; cell < kGrid * kGrid * kGrid; ++cell) {
    const double x = static_cast<double>(cell / (kGrid * kGrid)) - middle;
    const double y = static_cast<double>(cell / kGrid % kGrid) - middle, z = static_cast<double>(cell % kGrid) - middle;
    cells.emplace_back(std::abs(std::sqrt(x * x + y * y + z * z) - radius), cell);
  }
  std::sort(cells.begin(), cells.end());
  std::vector<std::int64_t> chosen;
  for (std::int64_t i = 0; i < voxels; ++i) chosen.push_back(cells[static_cast<std::size_t>(i)].second);
  std::sort(chosen.begin(), chosen.end());
  std::vector<std::int32_t> coords;
  for (const std::int64_t cell : chosen) {
    for (const std::int64_t value : {std::int64_t{0}, cell / (kGrid * kGrid), cell / kGrid % kGrid, cell % kGrid})
      coords.push_back(static_cast<std::int32_t>(value));
  }
  return anigen::sparse::Support::create(torch::tensor(coords, torch::kInt32).view({voxels, 4}));
}

double pairs_of(const SupportPtr& support) { return support->neighbours().ge(0).sum().item<double>(); }

using Convolution = std::function<Tensor(const Tensor&, const Tensor&, const Tensor&)>;

// Features, weight and bias of a convolution, and the multiplications it has to do for each product of two channels.
struct Layer {
  Tensor feats, weight, bias;
  double products;

  double flops() const {
    const double in = static_cast<double>(feats.size(1)), out = static_cast<double>(weight.size(0));
    return 2.0 * products * in * out;
  }
};

void add_tasks(std::vector<TimedTask>& tasks, const std::string& name, const Layer& layer,
               const Convolution& convolution) {
  tasks.push_back({name + "_forward", layer.flops(), [=] {
                     const torch::NoGradGuard no_grad;
                     convolution(layer.feats, layer.weight, layer.bias);
                   }});
  std::vector<Tensor> inputs;
  for (const Tensor& input : {layer.feats, layer.weight, layer.bias})
    inputs.push_back(input.detach().clone().requires_grad_());
  tasks.push_back({name + "_training", 3.0 * layer.flops(),
                   [=] { torch::autograd::grad({convolution(inputs[0], inputs[1], inputs[2]).sum()}, inputs); }});
}

void add_sparse(std::vector<TimedTask>& tasks, std::int64_t voxels, std::int64_t width) {
  const SupportPtr support = shell_of(voxels);
  const Layer layer{torch::randn({voxels, width}), torch::randn({width, 3, 3, 3, width}), torch::randn({width}),
                    pairs_of(support)};
  add_tasks(tasks, "sparse_" + std::to_string(width) + "_channels_" + std::to_string(voxels) + "_voxels", layer,
            [support](const Tensor& x, const Tensor& w, const Tensor& b) {
              return anigen::sparse::submanifold_convolution(*support, x, w, b);
            });
}

void add_sparse_bf16(std::vector<TimedTask>& tasks, std::int64_t voxels, std::int64_t width, int product) {
  const SupportPtr support = shell_of(voxels);
  const Tensor x = torch::randn({voxels, width}).to(torch::kBFloat16),
               w = torch::randn({width, 3, 3, 3, width}).to(torch::kBFloat16);
  const double flops = Layer{x, w, Tensor(), pairs_of(support)}.flops();
  tasks.push_back({"sparse_bf16_" + std::to_string(width) + "_channels_" + std::to_string(voxels) + "_voxels_forward",
                   flops,
                   [=] {
                     const torch::NoGradGuard no_grad;
                     anigen::sparse::submanifold_convolution(*support, x, w, Tensor());
                   },
                   product});
}

void add_dense(std::vector<TimedTask>& tasks, std::int64_t width) {
  const Layer layer{torch::randn({1, width, kGrid, kGrid, kGrid}), torch::randn({width, width, 3, 3, 3}),
                    torch::randn({width}), 27.0 * static_cast<double>(kGrid * kGrid * kGrid)};
  add_tasks(tasks, "dense_" + std::to_string(width) + "_channels", layer,
            [](const Tensor& x, const Tensor& w, const Tensor& b) {
              return torch::conv3d(x, w, b, {1, 1, 1}, {1, 1, 1});
            });
}

// Both count the products that repeated features need.
void add_subdivided(std::vector<TimedTask>& tasks, std::int64_t width) {
  const SupportPtr support = shell_of(kCoarseVoxels);
  const Layer layer{torch::randn({kCoarseVoxels, width}), torch::randn({width / 2, 3, 3, 3, width}),
                    torch::randn({width / 2}), pairs_of(support->subdivided())};
  const std::string name = "subdivided_" + std::to_string(width) + "_channels_";
  add_tasks(tasks, name + "repeated", layer, [support](const Tensor& x, const Tensor& w, const Tensor& b) {
    const anigen::sparse::SparseTensor fine = anigen::sparse::subdivide({support, x});
    return anigen::sparse::submanifold_convolution(*fine.support, fine.feats, w, b);
  });
  add_tasks(tasks, name + "folded", layer, [support](const Tensor& x, const Tensor& w, const Tensor& b) {
    return anigen::sparse::subdivided_convolution(*support, x, w, b);
  });
}

}  // namespace

int main(int argc, char** argv) {
  const std::optional<anigen::BenchmarkFlags> flags = anigen::start_timing(argc, argv);
  if (!flags) return 2;
  std::vector<TimedTask> tasks;
  tasks.push_back(anigen::product_task());                           // what the others are shares of
  const int product = anigen::add_product(tasks, torch::kBFloat16);  // and those in bf16
  for (const std::int64_t width : kWidths) {
    for (const std::int64_t voxels : kVoxels) add_sparse(tasks, voxels, width);
    add_sparse_bf16(tasks, kVoxels[2], width, product);
    add_dense(tasks, width);
    add_subdivided(tasks, width);
  }
  const int rounds = anigen::time_in_turn(tasks, *flags, kRounds);
  std::printf("fp32 unless said, %d threads; medians of %d rounds\n", at::get_num_threads(), rounds);
  for (const std::int64_t voxels : kVoxels) {
    const SupportPtr support = shell_of(voxels);
    std::printf("%lld voxels: %.1f%% of %lld^3, %.1f neighbours each\n", static_cast<long long>(voxels),
                100.0 * static_cast<double>(voxels) / static_cast<double>(kGrid * kGrid * kGrid),
                static_cast<long long>(kGrid), pairs_of(support) / static_cast<double>(voxels));
  }
  anigen::print_table(tasks);
  if (!flags->out.empty()) anigen::write_json(flags->out, "benchmark_sparse_convolution", "sparse_convolution/", tasks);
  return 0;
}
