// What a step of the published sparse-structure flow costs: 24 blocks, two streams of 4,096 tokens and width 1024,
// 1,374 condition tokens. Seconds and FLOP/s beside the machine's own matrix products in the same type, measured in
// between, and beside the same model as eager LibTorch code runs it.
//   benchmark_sparse_structure_flow [--fp32] [--bf16] [--blocks=24] [--steps=3] [--plain-steps=1] [--threads=N]
//                                   [--benchmark_out=FILE]
// Without --fp32 and --bf16 it does both. Other --benchmark_* flags are accepted and ignored.
#include <ATen/Parallel.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <functional>
#include <string>
#include <vector>

#include "anigen/core/atomic_file.h"
#include "anigen/core/json.h"
#include "anigen/core/parallel.h"
#include "anigen/models/sparse_structure_flow_flops.h"
#include "benchmarks/plain_sparse_structure_flow.h"

namespace {

using torch::Tensor;

constexpr std::int64_t kConditionTokens = 1374;  // of DINOv2 ViT-L/14 with registers at 518 x 518
constexpr std::int64_t kProductSide = 2048;

struct Settings {
  std::vector<torch::Dtype> dtypes;
  std::int64_t blocks = 24;
  int steps = 3, plain_steps = 1, threads = 0;
  std::string out;
};

struct Timed {
  double seconds = 0.0;       // median of the steps
  double product_rate = 0.0;  // median of the products around them, FLOP/s
};

double seconds_of(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 0.0 : values[values.size() / 2];
}

double peak_gigabytes() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) * 1024.0 / 1e9;
}

anigen::models::SparseStructureFlowOptions published_options(std::int64_t blocks) {
  anigen::models::SparseStructureFlowOptions options;
  options.resolution = 16;
  options.in_channels = options.out_channels = 8;
  options.in_channels_skl = options.out_channels_skl = 4;
  options.model_channels = options.model_channels_skl = options.cond_channels = 1024;
  options.num_blocks = blocks;
  options.num_heads = 16;
  options.patch_size = 1;
  options.qk_rms_norm = true;
  options.use_fp16 = true;
  options.freeze_pretrain_branch = false;
  return options;
}

// Cheap values in place of an initialisation: a sine pattern, and ones for norms.
void fill(torch::nn::Module& model) {
  const Tensor pattern = 0.03 * torch::sin(0.37 * torch::arange(1 << 20, torch::kFloat64)).to(torch::kFloat32);
  for (const auto& item : model.named_parameters()) {
    Tensor flat = item.value().detach().view({-1});
    const bool norm = item.key().find("norm") != std::string::npos && item.key().find("bias") == std::string::npos;
    if (norm) {
      flat.fill_(1.0);
      continue;
    }
    for (std::int64_t done = 0; done < flat.size(0); done += pattern.size(0)) {
      const std::int64_t count = std::min(pattern.size(0), flat.size(0) - done);
      flat.narrow(0, done, count).copy_(pattern.narrow(0, 0, count));
    }
  }
}

// Steps with a large product before and after each, so that both see the same machine.
Timed time_steps(int steps, torch::Dtype dtype, const std::function<void()>& step) {
  const Tensor a = torch::ones({kProductSide, kProductSide}, dtype), b = torch::ones_like(a);
  Tensor c = torch::empty_like(a);
  const auto product = [&] { at::mm_out(c, a, b); };
  const double flop = 2.0 * static_cast<double>(kProductSide) * kProductSide * kProductSide;
  product();
  std::vector<double> times, rates;
  for (int i = 0; i < steps; ++i) {
    rates.push_back(flop / seconds_of(product));
    times.push_back(seconds_of(step));
    rates.push_back(flop / seconds_of(product));
  }
  return {median(times), median(rates)};
}

void report(const std::string& name, const Timed& timed, double flop, anigen::Json& list) {
  const double rate = flop / timed.seconds, peak = peak_gigabytes();
  std::printf(
      "%-22s %9.2f s per step, %7.1f GFLOP/s = %5.1f %% of matrix products (%.1f GFLOP/s); peak so far %.2f GB\n",
      name.c_str(), timed.seconds, rate / 1e9, 100.0 * rate / timed.product_rate, timed.product_rate / 1e9, peak);
  list.push_back({{"name", "sparse_structure_flow/" + name},
                  {"run_type", "iteration"},
                  {"iterations", 1},
                  {"real_time", 1e3 * timed.seconds},
                  {"cpu_time", 1e3 * timed.seconds},
                  {"time_unit", "ms"},
                  {"flop", flop},
                  {"share_of_matrix_product", rate / timed.product_rate},
                  {"peak_gigabytes", peak}});
}

void run(torch::Dtype dtype, const Settings& settings, anigen::Json& list) {
  const torch::NoGradGuard no_grad;
  const auto options = published_options(settings.blocks);
  anigen::models::SparseStructureFlow model(options, anigen::nn::Init::kNone);
  fill(*model);
  if (dtype != torch::kFloat32) model->set_compute_dtype(dtype);
  const Tensor x = torch::ones(model->shape_latent_size(1)), x_skl = torch::ones(model->skeleton_latent_size(1));
  const Tensor t = torch::full({1}, 500.0f);
  const Tensor cond = torch::sin(torch::arange(kConditionTokens * options.cond_channels, torch::kFloat32))
                          .view({1, kConditionTokens, options.cond_channels});
  const anigen::models::FlopCount flop = anigen::models::forward_flops(options, 1, kConditionTokens);
  const std::string type = dtype == torch::kFloat32 ? "fp32" : "bf16";
  std::printf("%s, %lld blocks, %d threads: %.3f TFLOP per forward pass, %.0f %% of them in attention\n", type.c_str(),
              static_cast<long long>(settings.blocks), at::get_num_threads(), flop.total() / 1e12,
              100.0 * flop.attention / flop.total());

  anigen::models::Velocity ours, plain;
  const Timed timed = time_steps(settings.steps, dtype, [&] { ours = model->forward(x, x_skl, t, cond); });
  report(type, timed, flop.total(), list);
  if (settings.plain_steps == 0) return;
  const anigen::benchmarks::PlainSparseStructureFlow eager(model);
  const Timed other = time_steps(settings.plain_steps, dtype, [&] { plain = eager.forward(x, x_skl, t, cond); });
  report(type + "_plain", other, flop.total(), list);
  const double size = plain.shape.abs().max().item<double>();
  std::printf("plain / ours: %.2f; largest difference of the outputs %.1e of the largest value\n\n",
              other.seconds / timed.seconds, (ours.shape - plain.shape).abs().max().item<double>() / size);
}

bool read_flag(const std::string& word, const std::string& name, long lowest, long& value) {
  const std::string flag = "--" + name + "=";
  if (word.compare(0, flag.size(), flag) != 0) return false;
  value = std::max(lowest, std::strtol(word.c_str() + flag.size(), nullptr, 10));
  return true;
}

bool read_settings(int argc, char** argv, Settings& settings) {
  const std::string out = "--benchmark_out=";
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    long number = 0;
    if (word == "--fp32") {
      settings.dtypes.push_back(torch::kFloat32);
    } else if (word == "--bf16") {
      settings.dtypes.push_back(torch::kBFloat16);
    } else if (read_flag(word, "blocks", 1, number)) {
      settings.blocks = number;
    } else if (read_flag(word, "steps", 1, number)) {
      settings.steps = static_cast<int>(number);
    } else if (read_flag(word, "plain-steps", 0, number)) {
      settings.plain_steps = static_cast<int>(number);
    } else if (read_flag(word, "threads", 1, number)) {
      settings.threads = static_cast<int>(number);
    } else if (word.compare(0, out.size(), out) == 0) {
      settings.out = word.substr(out.size());
    } else if (word.compare(0, 12, "--benchmark_") != 0) {
      return false;
    }
  }
  if (settings.dtypes.empty()) settings.dtypes = {torch::kFloat32, torch::kBFloat16};
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  Settings settings;
  if (!read_settings(argc, argv, settings)) {
    std::fprintf(stderr,
                 "usage: benchmark_sparse_structure_flow [--fp32] [--bf16] [--blocks=N] [--steps=N] [--plain-steps=N] "
                 "[--threads=N] [--benchmark_out=FILE]\n");
    return 2;
  }
  try {
    at::set_num_threads(settings.threads > 0 ? settings.threads : anigen::thread_count());
    anigen::Json list = anigen::Json::array();
    for (const torch::Dtype dtype : settings.dtypes) run(dtype, settings, list);
    if (settings.out.empty()) return 0;
    const anigen::Json json = {{"context", {{"executable", "benchmark_sparse_structure_flow"}}}, {"benchmarks", list}};
    anigen::write_file_atomically(settings.out, json.dump(2) + "\n");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
