// Cost of a pass of the published structured-latent flow: 24 blocks, widths 1024, 512 and 512, 1,374 condition
// tokens, on voxels of a real asset or of an ellipsoid of about as many. Seconds and FLOP/s beside the machine's own
// matrix products in the same type, measured in between; a guided step of the sampler takes two passes.
//   benchmark_structured_latent_flow [--fp32] [--bf16] [--int8] [--voxels=PLY --skeleton-voxels=PLY] [--blocks=24]
//   [--steps=2]
//                                    [--threads=N] [--profile] [--benchmark_out=FILE]
// Voxel files are those of a dataset at 64³ (voxels/<id>.ply). Without --fp32 and --bf16 it takes bf16.
#include "anigen/core/openblas.h"
#include "anigen/structured_latent/flow.h"
#include "benchmarks/ellipsoid_voxels.h"
#include "benchmarks/flow_voxels.h"
#include "benchmarks/model_timing.h"
#include "benchmarks/structured_latent_flow_flops.h"

namespace {

using namespace anigen::benchmarks;
using anigen::geometry::Voxel;

constexpr const char* kFamily = "structured_latent_flow";
constexpr std::int64_t kConditionTokens = 1374;  // of DINOv2 ViT-L/14 with registers at 518 x 518
constexpr int kResolution = 64;

struct Settings : FlowSettings {
  std::string voxels, skeleton_voxels;
};

anigen::sparse::SparseTensor voxels_of(const std::string& file, std::vector<Voxel> otherwise, std::int64_t channels) {
  const anigen::sparse::SupportPtr support = voxels_or_ellipsoid(file, std::move(otherwise), kResolution);
  const Tensor feats = torch::sin(torch::arange(support->size() * channels, torch::kFloat32));
  return {support, feats.view({-1, channels})};
}

anigen::structured_latent::StructuredLatentFlowOptions published_options(std::int64_t blocks) {
  const anigen::Json args = {{"resolution", kResolution},
                             {"in_channels", 8},
                             {"in_channels_vert_skin", 8},
                             {"in_channels_skl", 4},
                             {"out_channels", 8},
                             {"out_channels_vert_skin", 8},
                             {"out_channels_skl", 4},
                             {"model_channels", 1024},
                             {"model_channels_vert_skin", 512},
                             {"model_channels_skl", 512},
                             {"cond_channels", 1024},
                             {"num_blocks", blocks},
                             {"num_heads", 16},
                             {"num_heads_vert_skin", 16},
                             {"num_heads_skl", 16},
                             {"io_block_channels", {128}},
                             {"io_block_channels_vert_skin", {64}},
                             {"io_block_channels_skl", {64}},
                             {"qk_rms_norm", true},
                             {"freeze_pretrain_branch", false}};
  return anigen::structured_latent::StructuredLatentFlowOptions::from_json(args);
}

void run(torch::Dtype dtype, const Settings& settings, anigen::Json& list) {
  const torch::NoGradGuard no_grad;
  const auto options = published_options(settings.blocks);
  anigen::structured_latent::StructuredLatentFlow model(options, anigen::nn::Init::kNone);
  fill_with_pattern(*model);
  if (dtype != torch::kFloat32) model->set_compute_dtype(dtype);
  const auto x = voxels_of(settings.voxels, ellipsoid_voxels(kResolution, 0.47, true), 16);
  const auto x_skl = voxels_of(settings.skeleton_voxels, ellipsoid_voxels(kResolution, 0.17, false), 4);
  const Tensor t = torch::full({1}, 500.0f);
  const Tensor cond = torch::sin(torch::arange(kConditionTokens * options.cond_channels, torch::kFloat32))
                          .view({1, kConditionTokens, options.cond_channels});
  const auto flop = anigen::structured_latent::forward_flops(
      options, anigen::structured_latent::count_voxels(*x.support, options.geometry.levels()),
      anigen::structured_latent::count_voxels(*x_skl.support, options.skeleton.levels()), kConditionTokens);
  const std::string type = anigen::word_of(anigen::nn::kFlowPrecisions, dtype);
  std::printf("%s, %lld blocks, %d threads, %lld + %lld voxels: %.3f TFLOP per pass\n", type.c_str(),
              static_cast<long long>(settings.blocks), at::get_num_threads(), static_cast<long long>(x.support->size()),
              static_cast<long long>(x_skl.support->size()), flop.total() / 1e12);
  std::fflush(stdout);
  const auto step = [&] { model->forward(x, x_skl, t, cond); };
  const Timed timed = time_steps(settings.steps, model->compute_dtype(), step);
  report_step(kFamily, type, timed, flop.total(), list);
  if (settings.profile) print_profile(step);
  std::printf("25 guided steps at this rate: %.0f min\n", 50 * timed.seconds / 60);
}

bool read_settings(int argc, char** argv, Settings& settings) {
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (!read_text(word, "voxels", settings.voxels) && !read_text(word, "skeleton-voxels", settings.skeleton_voxels) &&
        !settings.read(word)) {
      return false;
    }
  }
  if (settings.dtypes.empty()) settings.dtypes = {torch::kBFloat16};
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  anigen::start_with_openblas_core(argv);  // as the programs do
  Settings settings;
  settings.steps = 2;
  if (!read_settings(argc, argv, settings)) {
    std::fprintf(
        stderr,
        "usage: benchmark_structured_latent_flow [--fp32] [--bf16] [--int8] [--voxels=PLY --skeleton-voxels=PLY] "
        "[--blocks=N] [--steps=N] [--threads=N] [--profile] [--benchmark_out=FILE]\n");
    return 2;
  }
  return run_flow_benchmark(kFamily, settings,
                            [&](torch::Dtype dtype, anigen::Json& list) { run(dtype, settings, list); });
}
