// Attention in shifted windows of a shell of voxels, as the structured latents have them: ours, without padding; the
// windows padded to the longest as one batch; and attention of all voxels with a mask. As shares of what the machine
// does on a large matrix product, counting only products that the windows need; and how ours grows with the number of
// voxels. All tasks are timed in turn, round after round, so that a machine whose speed wanders treats them alike;
// compare only figures of one run. Prints a table; with --benchmark_out=FILE also Google Benchmark's JSON. Other
// --benchmark_* flags are accepted and ignored.
#include <ATen/Parallel.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "anigen/nn/attention.h"
#include "anigen/nn/ragged_attention.h"
#include "anigen/sparse/support.h"
#include "benchmarks/benchmark_flags.h"
#include "benchmarks/timed_tasks.h"

namespace {

using anigen::TimedTask;
using torch::Tensor;

constexpr int kRounds = 5;
constexpr std::int64_t kHeads = 12, kChannels = 64, kWindow = 8, kShift = 4;
constexpr std::int64_t kFewHeads = 2;  // with a mask, all heads would need many GiB
constexpr std::int64_t kSmallGrid = 32, kGrid = 64;
constexpr std::int64_t kGrowthGrids[] = {22, 32, 45,
                                         64, 90, 122};  // from 2 to 65 thousand voxels, twice as many each time

// Voxels near a sphere that fills most of the grid.
anigen::sparse::SupportPtr shell(std::int64_t grid) {
  const double middle = 0.5 * static_cast<double>(grid - 1), radius = 0.45 * static_cast<double>(grid);
  std::vector<std::int32_t> coords;
  for (std::int64_t x = 0; x < grid; ++x) {
    for (std::int64_t y = 0; y < grid; ++y) {
      for (std::int64_t z = 0; z < grid; ++z) {
        const double dx = static_cast<double>(x) - middle, dy = static_cast<double>(y) - middle;
        const double dz = static_cast<double>(z) - middle;
        if (std::abs(std::sqrt(dx * dx + dy * dy + dz * dz) - radius) > 0.87) continue;
        for (const std::int64_t value : {std::int64_t{0}, x, y, z}) coords.push_back(static_cast<std::int32_t>(value));
      }
    }
  }
  const auto rows = static_cast<std::int64_t>(coords.size() / 4);
  return anigen::sparse::Support::create(torch::tensor(coords, torch::kInt32).view({rows, 4}));
}

// Queries, keys and values in the order of the windows, side by side in each row as a projection leaves them.
struct Windows {
  Windows(std::int64_t grid, std::int64_t head_count) : heads(head_count) {
    const anigen::sparse::SupportPtr support = shell(grid);
    const anigen::sparse::WindowOrder& order = support->windows(kWindow, kShift);
    offsets = order.offsets.clone();
    rows = support->size();
    lengths = offsets.diff();
    longest = order.longest;
    const auto parts = torch::randn({rows, 3, heads, kChannels}).unbind(1);
    inputs.assign(parts.begin(), parts.end());
    direction = torch::randn({rows, heads, kChannels});
  }
  // Of the products that the windows need, forward.
  double flops() const { return 4.0 * static_cast<double>(heads * kChannels) * lengths.square().sum().item<double>(); }

  std::int64_t heads, rows = 0, longest = 0;
  Tensor offsets, lengths, direction;
  std::vector<Tensor> inputs;
};

using WindowAttention = std::function<Tensor(const Tensor&, const Tensor&, const Tensor&)>;

WindowAttention ragged(const Windows& windows) {
  return [offsets = windows.offsets](const Tensor& q, const Tensor& k, const Tensor& v) {
    return anigen::nn::ragged_attention(q, k, v, offsets, offsets);
  };
}

// Every window padded to the longest, as a batch. The index is worked out beforehand, as a support would keep it.
WindowAttention padded(const Windows& windows) {
  const std::int64_t count = windows.lengths.size(0), longest = windows.longest;
  const Tensor steps = torch::arange(longest).unsqueeze(0), lengths = windows.lengths.unsqueeze(1);
  const Tensor real = steps < lengths;
  const Tensor index =
      (windows.offsets.narrow(0, 0, count).unsqueeze(1) + torch::minimum(steps, lengths - 1)).flatten();
  const Tensor kept = real.flatten().nonzero().flatten();
  const Tensor mask =
      torch::zeros({count, longest}).masked_fill(real.logical_not(), -std::numeric_limits<double>::infinity());
  return [=](const Tensor& q, const Tensor& k, const Tensor& v) {
    const auto pad = [&](const Tensor& x) {
      return x.index_select(0, index).view({count, longest, x.size(1), x.size(2)}).transpose(1, 2);
    };
    const Tensor mixed = anigen::nn::attend(pad(q), pad(k), pad(v), mask.view({count, 1, 1, longest}));
    return mixed.transpose(1, 2).flatten(0, 1).index_select(0, kept);
  };
}

// All voxels see all, but for a mask.
WindowAttention masked(const Windows& windows) {
  const Tensor groups = torch::repeat_interleave(torch::arange(windows.lengths.size(0)), windows.lengths);
  const Tensor apart = groups.unsqueeze(0) != groups.unsqueeze(1);
  const Tensor mask =
      torch::zeros({windows.rows, windows.rows}).masked_fill(apart, -std::numeric_limits<double>::infinity());
  return [=](const Tensor& q, const Tensor& k, const Tensor& v) {
    return anigen::nn::attend(q.transpose(0, 1), k.transpose(0, 1), v.transpose(0, 1), mask).transpose(0, 1);
  };
}

TimedTask forward_task(const std::string& name, const Windows& windows, const WindowAttention& attention) {
  const auto work = [in = windows.inputs, attention] {
    const torch::NoGradGuard no_grad;
    attention(in[0], in[1], in[2]);
  };
  return {name, windows.flops(), work};
}

TimedTask bf16_forward_task(const std::string& name, const Windows& windows, const WindowAttention& attention,
                            int product) {
  std::vector<Tensor> in;
  for (const Tensor& input : windows.inputs) in.push_back(input.to(torch::kBFloat16));
  const auto work = [in, attention] {
    const torch::NoGradGuard no_grad;
    attention(in[0], in[1], in[2]);
  };
  return {name, windows.flops(), work, product};
}

TimedTask training_task(const std::string& name, const Windows& windows, const WindowAttention& attention) {
  std::vector<Tensor> in;
  for (const Tensor& input : windows.inputs) in.push_back(input.detach().requires_grad_());
  const auto work = [in, attention, direction = windows.direction] {
    torch::autograd::grad({attention(in[0], in[1], in[2])}, in, {direction});
  };
  return {name, 3.0 * windows.flops(), work};
}

void describe(const char* what, const Windows& windows) {
  std::printf("%s: %lld voxels, %lld windows, the longest %lld, %lld heads\n", what,
              static_cast<long long>(windows.rows), static_cast<long long>(windows.lengths.size(0)),
              static_cast<long long>(windows.longest), static_cast<long long>(windows.heads));
}

}  // namespace

int main(int argc, char** argv) {
  const std::optional<anigen::BenchmarkFlags> flags = anigen::start_timing(argc, argv);
  if (!flags) return 2;
  std::vector<TimedTask> tasks;
  tasks.push_back(anigen::product_task());  // what the others are shares of
  const Windows small(kSmallGrid, kFewHeads), large(kGrid, kHeads);
  tasks.push_back(forward_task("masked_forward_small", small, masked(small)));
  tasks.push_back(forward_task("ragged_forward_small", small, ragged(small)));
  tasks.push_back(training_task("masked_training_small", small, masked(small)));
  tasks.push_back(training_task("ragged_training_small", small, ragged(small)));
  tasks.push_back(forward_task("padded_forward", large, padded(large)));
  tasks.push_back(forward_task("ragged_forward", large, ragged(large)));
  const int product = anigen::add_product(tasks, torch::kBFloat16);
  tasks.push_back(bf16_forward_task("padded_forward_bf16", large, padded(large), product));
  tasks.push_back(bf16_forward_task("ragged_forward_bf16", large, ragged(large), product));
  tasks.push_back(training_task("padded_training", large, padded(large)));
  tasks.push_back(training_task("ragged_training", large, ragged(large)));
  for (const std::int64_t grid : kGrowthGrids) {
    const Windows windows(grid, kHeads);
    tasks.push_back(
        training_task("ragged_training_" + std::to_string(windows.rows) + "_voxels", windows, ragged(windows)));
  }
  const int rounds = anigen::time_in_turn(tasks, *flags, kRounds);
  std::printf(
      "windows of %lld voxels shifted by %lld, heads of %lld channels, fp32 unless said, %d threads; medians of %d "
      "rounds\n",
      static_cast<long long>(kWindow), static_cast<long long>(kShift), static_cast<long long>(kChannels),
      at::get_num_threads(), rounds);
  describe("small", small);
  describe("others", large);
  anigen::print_table(tasks);
  if (!flags->out.empty()) anigen::write_json(flags->out, "benchmark_ragged_attention", "ragged_attention/", tasks);
  return 0;
}
