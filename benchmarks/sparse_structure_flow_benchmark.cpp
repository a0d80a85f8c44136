// Cost of a step of the published sparse-structure flow: 24 blocks, two streams of 4,096 tokens and width 1024,
// 1,374 condition tokens. Seconds and FLOP/s beside the machine's own matrix products in the same type, measured in
// between, and beside the same model as eager LibTorch code runs it.
//   benchmark_sparse_structure_flow [--fp32] [--bf16] [--int8] [--blocks=24] [--steps=3] [--plain-steps=1]
//   [--threads=N]
//                                   [--profile] [--benchmark_out=FILE]
// Without --fp32 and --bf16 it does both. Other --benchmark_* flags are accepted and ignored.
#include <cstdio>
#include <string>
#include <vector>

#include "anigen/core/openblas.h"
#include "anigen/sparse_structure/flow.h"
#include "benchmarks/model_timing.h"
#include "benchmarks/plain_sparse_structure_flow.h"
#include "benchmarks/sparse_structure_flow_flops.h"

namespace {

using namespace anigen::benchmarks;

constexpr std::int64_t kConditionTokens = 1374;  // of DINOv2 ViT-L/14 with registers at 518 x 518
constexpr const char* kFamily = "sparse_structure_flow";

struct Settings : FlowSettings {
  int plain_steps = 1;
};

anigen::sparse_structure::SparseStructureFlowOptions published_options(std::int64_t blocks) {
  anigen::sparse_structure::SparseStructureFlowOptions options;
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

void run(torch::Dtype dtype, const Settings& settings, anigen::Json& list) {
  const torch::NoGradGuard no_grad;
  const auto options = published_options(settings.blocks);
  anigen::sparse_structure::SparseStructureFlow model(options, anigen::nn::Init::kNone);
  fill_with_pattern(*model);
  if (dtype != torch::kFloat32) model->set_compute_dtype(dtype);
  const Tensor x = torch::ones(model->shape_latent_size(1)), x_skl = torch::ones(model->skeleton_latent_size(1));
  const Tensor t = torch::full({1}, 500.0f);
  const Tensor cond = torch::sin(torch::arange(kConditionTokens * options.cond_channels, torch::kFloat32))
                          .view({1, kConditionTokens, options.cond_channels});
  const anigen::nn::FlopCount flop = anigen::sparse_structure::forward_flops(options, 1, kConditionTokens);
  const std::string type = anigen::word_of(anigen::nn::kFlowPrecisions, dtype);
  std::printf("%s, %lld blocks, %d threads: %.3f TFLOP per forward pass, %.0f %% of them in attention\n", type.c_str(),
              static_cast<long long>(settings.blocks), at::get_num_threads(), flop.total() / 1e12,
              100.0 * flop.attention / flop.total());

  anigen::sparse_structure::Velocity ours, plain;
  const auto step = [&] { ours = model->forward(x, x_skl, t, cond); };
  const Timed timed = time_steps(settings.steps, model->compute_dtype(), step);
  report_step(kFamily, type, timed, flop.total(), list);
  if (settings.profile) print_profile(step);
  if (settings.plain_steps == 0 || dtype == torch::kInt8) return;  // the plain model needs the weights themselves
  const anigen::benchmarks::PlainSparseStructureFlow eager(model);
  const Timed other = time_steps(settings.plain_steps, dtype, [&] { plain = eager.forward(x, x_skl, t, cond); });
  report_step(kFamily, type + "_plain", other, flop.total(), list);
  const double size = plain.shape.abs().max().item<double>();
  std::printf("plain / ours: %.2f; largest difference of the outputs %.1e of the largest value\n\n",
              other.seconds / timed.seconds, (ours.shape - plain.shape).abs().max().item<double>() / size);
}

bool read_settings(int argc, char** argv, Settings& settings) {
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    long number = 0;
    if (read_number(word, "plain-steps", 0, number)) {
      settings.plain_steps = static_cast<int>(number);
    } else if (!settings.read(word)) {
      return false;
    }
  }
  if (settings.dtypes.empty()) settings.dtypes = {torch::kFloat32, torch::kBFloat16};
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  anigen::start_with_openblas_core(argv);  // as the programs do
  Settings settings;
  settings.steps = 3;
  if (!read_settings(argc, argv, settings)) {
    std::fprintf(
        stderr,
        "usage: benchmark_sparse_structure_flow [--fp32] [--bf16] [--int8] [--blocks=N] [--steps=N] [--plain-steps=N] "
        "[--threads=N] [--profile] [--benchmark_out=FILE]\n");
    return 2;
  }
  return run_flow_benchmark(kFamily, settings,
                            [&](torch::Dtype dtype, anigen::Json& list) { run(dtype, settings, list); });
}
