// Cost of a training step of the published structured-latent auto-encoder: encoder and decoder of
// configs/published/slat_dae.json, forward and backward, on about 20 thousand voxels of an ellipsoid with 5 thousand
// of a skeleton and the rig of a creature. Seconds, peak memory beside what the estimate behind memory_budget_mb says,
// and where the time goes.
//   benchmark_structured_latent_autoencoder [--recompute] [--train-all] [--decode] [--blocks=12] [--threads=N]
//                                           [--benchmark_out=FILE]
// --recompute: blocks keep only their inputs for the backward pass. --train-all: nothing is frozen (the published
// config freezes geometry and SkinAE). --decode: instead of a training step, what generation does with the latents:
// decoder, surface, and the weights of its vertices.
#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"
#include "anigen/core/log.h"
#include "anigen/core/openblas.h"
#include "anigen/creatures/body.h"
#include "anigen/data/voxel_files.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/nn/profile.h"
#include "anigen/structured_latent/decoder.h"
#include "anigen/structured_latent/encoder.h"
#include "anigen/train/stages/structured_latent_report.h"
#include "benchmarks/ellipsoid_voxels.h"
#include "benchmarks/model_timing.h"

namespace {

using namespace anigen::benchmarks;

constexpr const char* kFamily = "structured_latent_autoencoder";
constexpr int kResolution = 64;

struct Settings {
  bool recompute = false, train_all = false, decode = false;
  long blocks = 12, threads = 0;
  std::string out;

  bool read(const std::string& word) {
    if (word == "--recompute") return recompute = true;
    if (word == "--train-all") return train_all = true;
    if (word == "--decode") return decode = true;
    return read_number(word, "blocks", 1, blocks) || read_number(word, "threads", 1, threads) ||
           read_text(word, "benchmark_out", out) || word.compare(0, 12, "--benchmark_") == 0;
  }
};

anigen::sparse::SparseTensor voxels_of(double scale, bool shell, std::int64_t channels) {
  anigen::data::VoxelRows rows;
  rows.coords = ellipsoid_voxels(kResolution, scale, shell);
  const auto ragged = anigen::data::collate_voxels({&rows}, {"ellipsoid"});
  const Tensor feats = torch::sin(torch::arange(ragged.coords.size(0) * channels, torch::kFloat32));
  return {anigen::sparse::Support::create(ragged.coords, 1), feats.view({-1, channels})};
}

anigen::structured_latent::RiggedMeshes rig_of(const anigen::Asset& asset) {
  const auto vertices = static_cast<std::int64_t>(asset.mesh.vertices.size());
  const auto faces = static_cast<std::int64_t>(asset.mesh.faces.size());
  const auto joints = static_cast<std::int64_t>(asset.skeleton.size());
  anigen::structured_latent::RiggedMeshes rigs;
  Tensor points = torch::empty({vertices, 3}), corners = torch::empty({faces, 3}, torch::kInt32);
  for (std::int64_t i = 0; i < vertices; ++i) {
    for (int k = 0; k < 3; ++k) points[i][k].fill_(asset.mesh.vertices[static_cast<std::size_t>(i)][k]);
  }
  for (std::int64_t i = 0; i < faces; ++i) {
    for (std::size_t k = 0; k < 3; ++k)
      corners[i][static_cast<std::int64_t>(k)].fill_(asset.mesh.faces[static_cast<std::size_t>(i)][k]);
  }
  Tensor places = torch::empty({joints, 3}), parents = torch::empty({joints}, torch::kInt32);
  const std::vector<Eigen::Vector3d> positions = asset.skeleton.positions();
  for (std::int64_t i = 0; i < joints; ++i) {
    for (int k = 0; k < 3; ++k) places[i][k].fill_(positions[static_cast<std::size_t>(i)][k]);
    parents[i].fill_(asset.skeleton.parents[static_cast<std::size_t>(i)]);
  }
  std::vector<float> dense = anigen::to_dense(asset.skin, static_cast<std::size_t>(joints));
  rigs.vertices = {points};
  rigs.faces = {corners};
  rigs.joints = {places};
  rigs.parents = {parents};
  rigs.skin = {torch::from_blob(dense.data(), {vertices, joints}).clone()};
  rigs.surfaces = {std::make_shared<const anigen::geometry::NearestSurface>(asset.mesh)};
  return rigs;
}

void add_row(const std::string& name, double seconds, anigen::Json& list) {
  list.push_back({{"name", std::string(kFamily) + "/" + name},
                  {"run_type", "iteration"},
                  {"iterations", 1},
                  {"real_time", 1e3 * seconds},
                  {"cpu_time", 1e3 * seconds},
                  {"time_unit", "ms"},
                  {"peak_gigabytes", peak_gigabytes()}});
}

void decode(anigen::structured_latent::StructuredLatentDecoder& decoder, const anigen::sparse::SparseTensor& x,
            const anigen::sparse::SparseTensor& x_skl, const anigen::skeleton_field::SkeletonTensors& skeleton,
            anigen::Json& list) {
  const torch::NoGradGuard no_grad;
  torch::manual_seed(0);
  const anigen::structured_latent::StructuredLatentDecoderOptions& options = decoder->options();
  const auto latents = [](const anigen::sparse::SparseTensor& at, std::int64_t channels) {
    return at.with(torch::randn({at.support->size(), channels}));
  };
  const anigen::structured_latent::PerStream<anigen::sparse::SparseTensor> z = {
      latents(x, options.latent_channels), latents(x, options.latent_channels_vertskin),
      latents(x_skl, options.latent_channels_skl)};
  anigen::structured_latent::StructuredLatentDecoderImpl::Fields decoded;
  const double fields = seconds_of([&] { decoded = decoder->forward(z, {skeleton}); });
  std::printf("fields   %8.2f s, peak so far %.2f GB\n", fields, peak_gigabytes());
  std::fflush(stdout);
  anigen::shape_field::ExtractedMesh mesh;
  const double surface = seconds_of([&] { mesh = decoder->extract_meshes(decoded, /*training=*/false).front(); });
  std::printf("surface  %8.2f s, peak so far %.2f GB: %lld vertices, %lld faces\n", surface, peak_gigabytes(),
              static_cast<long long>(mesh.vertices.size(0)), static_cast<long long>(mesh.faces.size(0)));
  std::fflush(stdout);
  const double skin =
      seconds_of([&] { decoder->skin_weights(mesh.skin_features, skeleton, decoded.joint_features.front().features); });
  std::printf("weights  %8.2f s, peak so far %.2f GB: %lld joints\n", skin, peak_gigabytes(),
              static_cast<long long>(skeleton.joints.size(0)));
  add_row("decode", fields + surface + skin, list);
}

void run(const Settings& settings, anigen::Json& list) {
  const anigen::Json config =
      anigen::load_config(std::string(ANIGEN_SOURCE_DIR) + "/configs/published/slat_dae.json").at("models");
  const auto args_of = [&](const char* part) {
    anigen::Json args = config.at(part).at("args");
    args["num_blocks"] = settings.blocks;
    if (settings.train_all) args["freeze_pretrain_branch"] = false;
    return args;
  };
  const auto encoder_options = anigen::structured_latent::StructuredLatentEncoderOptions::from_json(args_of("encoder"));
  const auto decoder_options = anigen::structured_latent::StructuredLatentDecoderOptions::from_json(args_of("decoder"));
  anigen::structured_latent::StructuredLatentEncoder encoder(encoder_options, anigen::nn::Init::kNone);
  anigen::structured_latent::StructuredLatentDecoder decoder(decoder_options, anigen::nn::Init::kNone);
  fill_with_pattern(*encoder);
  fill_with_pattern(*decoder);
  encoder->recompute_blocks(settings.recompute);
  decoder->recompute_blocks(settings.recompute);
  const double weights = peak_gigabytes();

  const auto x = voxels_of(0.47, true, encoder_options.in_channels), x_skl = voxels_of(0.17, false, 1);
  const anigen::structured_latent::RiggedMeshes rigs = rig_of(anigen::creatures::make_creature("quadruped", 0, 0));
  const std::vector<anigen::skeleton_field::SkeletonTensors> skeletons = {
      {rigs.joints[0], rigs.parents[0].to(torch::kInt64)}};
  const double activations = static_cast<double>(anigen::train::activation_bytes(
                                 encoder_options, decoder_options, x.support->size(), x_skl.support->size())) /
                             1e9;
  std::printf("fp32, %ld blocks, %d threads, %lld + %lld voxels%s%s; models %.2f GB, activations by estimate %.2f GB\n",
              settings.blocks, at::get_num_threads(), static_cast<long long>(x.support->size()),
              static_cast<long long>(x_skl.support->size()), settings.recompute ? ", recomputed" : "",
              settings.train_all ? ", all trained" : "", weights, activations);
  std::fflush(stdout);

  if (settings.decode) return decode(decoder, x, x_skl, skeletons.front(), list);
  const anigen::nn::OperatorProfile profile;
  double forward = 0.0;
  const double all = seconds_of([&] {
    Tensor loss;
    forward = seconds_of([&] {
      const auto latents = encoder->forward(x, x_skl, rigs);
      const anigen::structured_latent::PerStream<anigen::sparse::SparseTensor> z = {
          latents.z.with(latents.z_geometry), latents.z.with(latents.z_skin), latents.z_skl};
      const auto decoded = decoder->forward(z, skeletons);
      loss = decoded.mesh.feats.square().mean() + decoded.skeleton.feats.square().mean();
    });
    std::printf("forward  %8.2f s, peak so far %.2f GB\n", forward, peak_gigabytes());
    std::fflush(stdout);
    loss.backward();
  });
  std::printf("backward %8.2f s, peak so far %.2f GB\n\n%s", all - forward, peak_gigabytes(),
              anigen::nn::profile_markdown(profile.rows(), 1, anigen::nn::measure_machine_peak()).c_str());
  add_row(settings.recompute ? "recomputed" : "kept", all, list);
}

}  // namespace

int main(int argc, char** argv) try {
  anigen::start_with_openblas_core(argv);  // as the programs do
  Settings settings;
  for (int i = 1; i < argc; ++i) {
    if (settings.read(argv[i])) continue;
    std::fprintf(stderr,
                 "usage: benchmark_structured_latent_autoencoder [--recompute] [--train-all] [--decode] [--blocks=N] "
                 "[--threads=N] [--benchmark_out=FILE]\n");
    return 2;
  }
  anigen::keep_freed_memory();  // as the programs do
  at::set_num_threads(settings.threads > 0 ? static_cast<int>(settings.threads) : anigen::thread_count());
  anigen::Json list = anigen::Json::array();
  run(settings, list);
  if (settings.out.empty()) return 0;
  const anigen::Json json = {{"context", {{"executable", std::string("benchmark_") + kFamily}}}, {"benchmarks", list}};
  anigen::write_file_atomically(settings.out, json.dump(2) + "\n");
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
