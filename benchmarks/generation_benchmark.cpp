// Cost of a whole generation with the published models: picture tokens by DINOv2, both flows with guidance, both
// decoders, on voxels of a real asset or of an ellipsoid of about as many. Seconds of every part, what 25 + 25 steps
// take at the rate of the steps that were made, and the most memory that was held. As `anigen-generate --precision
// bf16`; with --low-memory one model at a time, as there. --whole takes the steps as those of a whole sampling, such as
// 12 of --adams with guidance every second step. --measures samples the 25 steps, then again with each measure that
// spares passes or makes them cheaper (or those whose name contains WORD): its passes and seconds, and how far its
// latents end from those. With --keep=FOLDER each sampling is written there when it ends, and a run that was stopped
// goes on after the last.
//   benchmark_generation [--fp32|--int8] [--low-memory] [--steps=3 [--whole] [--adams] [--guidance-every=N]]
//                        [--measures|--measures=WORD] [--keep=FOLDER] [--voxels=PLY --skeleton-voxels=PLY]
//                        [--blocks=N] [--threads=N] [--benchmark_out=FILE]
// Weights are a pattern, which takes as long as trained ones but gives no shape: the second flow and the decoder work
// on the voxels given, so that reading weights, normals of the picture and finishing of the mesh are not in it.
#include <filesystem>
#include <optional>
#include <stdexcept>

#include "anigen/core/config.h"
#include "anigen/core/log.h"
#include "anigen/core/openblas.h"
#include "anigen/generate/asset_generator.h"
#include "anigen/sparse_structure/autoencoder.h"
#include "anigen/sparse_structure/flow.h"
#include "anigen/structured_latent/decoder.h"
#include "anigen/structured_latent/sampling.h"
#include "anigen/vision/dinov2.h"
#include "benchmarks/ellipsoid_voxels.h"
#include "benchmarks/flow_voxels.h"
#include "benchmarks/model_timing.h"

namespace {

using namespace anigen;
using namespace anigen::benchmarks;

constexpr int kResolution = 64;
constexpr std::int64_t kPictureSide = 518, kPublishedSteps = 25;
constexpr std::int64_t kJoints = 40;
constexpr double kStructureStrength = 7.5, kLatentStrength = 3.0;  // of the published pipeline

struct Settings : FlowSettings {
  bool low_memory = false, whole = false, adams = false, measures = false;
  long guidance_every = 1;
  std::string measure, keep, voxels, skeleton_voxels;

  bool read(const std::string& word) {
    if (word == "--low-memory") return low_memory = true;
    if (word == "--whole") return whole = true;
    if (word == "--adams") return adams = true;
    if (word == "--measures" || read_text(word, "measures", measure)) return measures = true;
    if (read_number(word, "guidance-every", 1, guidance_every)) return true;
    return read_text(word, "keep", keep) || read_text(word, "voxels", voxels) ||
           read_text(word, "skeleton-voxels", skeleton_voxels) || FlowSettings::read(word);
  }
  // Everything that changes latents or their cost.
  std::string described() const {
    return std::string(torch::toString(dtypes.front())) + (low_memory ? ", low memory, " : ", ") +
           std::to_string(blocks) + " blocks, " + std::to_string(steps) + " steps, " + std::to_string(threads) +
           " threads, voxels '" + voxels + "' and '" + skeleton_voxels + "'";
  }
};

// A way to sample a flow. The first one is what the others are measured by.
struct Measure {
  std::string name;
  flow::SamplerOptions sampler;
};

std::vector<Measure> measures_of(const Settings& settings) {
  flow::SamplerOptions all;
  all.steps = settings.steps;
  if (!settings.measures) {
    if (settings.adams) all.solver = flow::Solver::kAdams;
    all.cfg_every = settings.guidance_every;
    return {{"", all}};
  }
  std::vector<Measure> measures = {{std::to_string(all.steps) + " guided steps", all}};
  const auto add = [&](const std::string& name, const std::function<void(flow::SamplerOptions&)>& change) {
    if (name.find(settings.measure) == std::string::npos) return;
    measures.push_back({name, all});
    change(measures.back().sampler);
  };
  const std::int64_t half = (all.steps + 1) / 2;
  const std::string half_steps = std::to_string(half) + " steps";
  for (const std::int64_t every : {2, 4}) {
    add("guidance every " + std::to_string(every) + " steps", [=](auto& sampler) { sampler.cfg_every = every; });
  }
  add("guidance while t >= 0.5", [](auto& sampler) { sampler.cfg_interval = {0.5, 1.0}; });
  for (const int percent : {2, 10}) {
    add("velocities predicted to " + std::to_string(percent) + " %",
        [=](auto& sampler) { sampler.velocity_tolerance = 0.01 * percent; });
  }
  for (const std::int64_t share : {4, 2}) {
    const std::int64_t first = (all.steps + share - 1) / share;
    add("windows in the first " + std::to_string(first) + " steps",
        [=](auto& sampler) { sampler.windowed_steps = first; });
  }
  add(half_steps, [=](auto& sampler) { sampler.steps = half; });
  add("adams, " + half_steps, [=](auto& sampler) { sampler.steps = half, sampler.solver = flow::Solver::kAdams; });
  add("adams, " + half_steps + ", guidance every 2",
      [=](auto& sampler) { sampler.steps = half, sampler.solver = flow::Solver::kAdams, sampler.cfg_every = 2; });
  return measures;
}

// Passes, seconds and ends of sampling both flows in one way.
struct Outcome {
  std::int64_t passes = 0;
  double seconds = 0.0;
  std::vector<double> distances;  // ‖z − z'‖ / ‖z'‖ of every stream of both flows, z' of the first measure

  void add(const Outcome& of_a_flow) {
    passes += of_a_flow.passes;
    seconds += of_a_flow.seconds;
    distances.insert(distances.end(), of_a_flow.distances.begin(), of_a_flow.distances.end());
  }
};

// The samplings of a run in the folder of --keep, and the latents that the others are measured by.
class KeptSamplings {
 public:
  KeptSamplings(const std::string& folder, const std::string& settings) : folder_(folder) {
    if (folder_.empty()) return;
    std::filesystem::create_directories(folder_);
    rows_ = {{"settings", settings}, {"samplings", Json::object()}};
    if (!std::filesystem::exists(file())) return;
    rows_ = Json::parse(read_file(file()));
    if (rows_.at("settings") == settings) return;
    throw std::runtime_error(file() + " is of other settings: " + rows_.at("settings").dump() + " and not " + settings);
  }

  std::optional<Outcome> find(const std::string& flow, const std::string& measure) const {
    const std::string name = flow + ", " + measure;
    if (folder_.empty() || !rows_.at("samplings").contains(name)) return std::nullopt;
    const Json& row = rows_.at("samplings").at(name);
    return Outcome{row.at("passes"), row.at("seconds"), row.at("distances").get<std::vector<double>>()};
  }
  void add(const std::string& flow, const std::string& measure, const Outcome& outcome) {
    if (folder_.empty()) return;
    rows_["samplings"][flow + ", " + measure] = {
        {"passes", outcome.passes}, {"seconds", outcome.seconds}, {"distances", outcome.distances}};
    write_file_atomically(file(), rows_.dump(2) + "\n");
  }

  flow::Streams latents(const std::string& flow) const {
    std::vector<Tensor> streams;
    torch::load(streams, folder_ + "/" + flow + ".pt");
    return streams;
  }
  void keep_latents(const std::string& flow, const flow::Streams& streams) const {
    if (!folder_.empty())
      torch::save(std::vector<Tensor>(streams.begin(), streams.end()), folder_ + "/" + flow + ".pt");
  }

 private:
  std::string file() const { return folder_ + "/samplings.json"; }

  const std::string folder_;
  Json rows_;
};

// Seconds of the parts, of sampling those of kPublishedSteps.
class Parts {
 public:
  explicit Parts(const Settings& settings) : settings_(settings) {}

  void add(const std::string& name, double seconds, std::int64_t steps = 0) {
    const double whole =
        steps == 0 || settings_.whole ? seconds : seconds / static_cast<double>(steps) * kPublishedSteps;
    whole_ += whole;
    measured_ += seconds;
    std::printf("%-24s %9.1f s", name.c_str(), seconds);
    if (steps > 0 && steps != kPublishedSteps && !settings_.whole) {
      std::printf(" for %lld steps, %.1f min for %lld", static_cast<long long>(steps), whole / 60.0,
                  static_cast<long long>(kPublishedSteps));
    }
    std::printf("; peak so far %.2f GB\n", peak_gigabytes());
    std::fflush(stdout);
    row(name, whole);
  }
  double whole() const { return whole_; }
  void finish() {
    std::printf("%-24s %9.1f min%s; measured %.1f min; peak %.2f GB = %.2f GiB%s\n",
                settings_.whole ? "whole" : "25 + 25 guided steps", whole_ / 60.0,
                settings_.steps == kPublishedSteps || settings_.whole ? "" : " at these rates", measured_ / 60.0,
                peak_gigabytes(), peak_gigabytes() * 1e9 / 1073741824.0,
                settings_.low_memory ? ", one model at a time" : "");
    row("all", whole_);
    if (settings_.out.empty()) return;
    const Json json = {{"context", {{"executable", "benchmark_generation"}}}, {"benchmarks", rows_}};
    write_file_atomically(settings_.out, json.dump(2) + "\n");
  }

 private:
  void row(const std::string& name, double seconds) {
    rows_.push_back({{"name", "generation/" + name},
                     {"run_type", "iteration"},
                     {"iterations", 1},
                     {"real_time", 1e3 * seconds},
                     {"cpu_time", 1e3 * seconds},
                     {"time_unit", "ms"},
                     {"peak_gigabytes", peak_gigabytes()}});
  }

  const Settings& settings_;
  Json rows_ = Json::array();
  double whole_ = 0.0, measured_ = 0.0;
};

Json published(const std::string& name, const char* part) {
  const std::string file = std::string(ANIGEN_SOURCE_DIR) + "/configs/published/" + name + ".json";
  return load_config(file).at("models").at(part).at("args");
}

Json flow_args(const std::string& name, const Settings& settings) {
  Json args = published(name, "denoiser");
  args["num_blocks"] = settings.blocks;
  return args;
}

template <typename Model, typename Options>
Model patterned(const Options& options, torch::Dtype dtype) {
  Model model(options, nn::Init::kNone);
  // Each weight is converted when it has its numbers, as a file's are that the programs read.
  fill_with_pattern(*model, dtype == torch::kFloat32 ? nullptr : model->conversion(dtype));
  release_freed_memory();
  return model;
}

// The parts in the order of a generation. Models stay in memory until the end, as a program's that makes several
// assets, unless one at a time is asked for.
class Generation {
 public:
  explicit Generation(const Settings& settings)
      : settings_(settings),
        measures_(measures_of(settings)),
        outcomes_(measures_.size()),
        kept_samplings_(settings.keep, settings.described()),
        parts_(settings) {}

  void run() {
    const torch::NoGradGuard no_grad;
    torch::manual_seed(0);
    for (const auto part : {&Generation::encode_picture, &Generation::sample_structure, &Generation::decode_structure,
                            &Generation::sample_latents, &Generation::decode_asset}) {
      (this->*part)();
      if (settings_.low_memory) release_freed_memory();
    }
    parts_.finish();
    if (settings_.measures) print_measures();
  }

 private:
  torch::Dtype dtype() const { return settings_.dtypes.front(); }
  template <typename Model>
  void keep(const Model& model) {
    if (!settings_.low_memory) kept_.push_back(model.ptr());
  }

  void encode_picture() {
    vision::Dinov2 encoder(vision::Dinov2Options::named("dinov2_vitl14_reg"));
    fill_with_pattern(*encoder);
    keep(encoder);
    const Tensor picture = torch::rand({1, 3, kPictureSide, kPictureSide});
    parts_.add("picture tokens", seconds_of([&] { tokens_ = encoder->forward(picture).x_norm; }));
  }

  void sample_structure() {
    const auto options = sparse_structure::SparseStructureFlowOptions::from_json(flow_args("ss_flow_duet", settings_));
    const auto model = patterned<sparse_structure::SparseStructureFlow>(options, dtype());
    keep(model);
    const flow::Streams noise = {torch::randn(model->shape_latent_size(1)),
                                 torch::randn(model->skeleton_latent_size(1))};
    sample("sparse structure", noise, sparse_structure::structure_velocities(model, tokens_, /*guided=*/true),
           kStructureStrength);
  }

  void decode_structure() {
    sparse_structure::SparseStructureDecoder decoder(
        sparse_structure::SparseStructureDecoderOptions::from_json(published("ss_dae", "decoder")));
    keep(decoder);
    const Tensor z = torch::randn({1, 8, 16, 16, 16}), z_skl = torch::randn({1, 4, 16, 16, 16});
    parts_.add("voxels", seconds_of([&] { decoder->forward(z, z_skl); }));
  }

  void sample_latents() {
    const auto options =
        structured_latent::StructuredLatentFlowOptions::from_json(flow_args("slat_flow_auto", settings_));
    const auto model = patterned<structured_latent::StructuredLatentFlow>(options, dtype());
    keep(model);
    shape_ = voxels_or_ellipsoid(settings_.voxels, ellipsoid_voxels(kResolution, 0.47, true), kResolution);
    skeleton_ = voxels_or_ellipsoid(settings_.skeleton_voxels, ellipsoid_voxels(kResolution, 0.17, false), kResolution);
    std::printf("%lld + %lld voxels\n", static_cast<long long>(shape_->size()),
                static_cast<long long>(skeleton_->size()));
    const structured_latent::StructuredLatentTarget target{shape_, skeleton_, tokens_, {}};
    const flow::Streams noise = structured_latent::structured_latent_noise(options, *shape_, *skeleton_, {},
                                                                           generate::noise_generator(/*seed=*/0));
    sample("structured latents", noise, structured_latent::structured_latent_velocities(model, target, /*guided=*/true),
           kLatentStrength);
  }

  // Of a skeleton given, since votes of a pattern make none.
  void decode_asset() {
    const auto options = structured_latent::StructuredLatentDecoderOptions::from_json(published("slat_dae", "decoder"));
    structured_latent::StructuredLatentDecoder decoder(options, nn::Init::kNone);
    fill_with_pattern(*decoder);
    keep(decoder);
    const auto latents = [](const sparse::SupportPtr& at, std::int64_t channels) {
      return sparse::SparseTensor{at, torch::randn({at->size(), channels})};
    };
    const structured_latent::PerStream<sparse::SparseTensor> z = {latents(shape_, options.latent_channels),
                                                                  latents(shape_, options.latent_channels_vertskin),
                                                                  latents(skeleton_, options.latent_channels_skl)};
    const skeleton_field::SkeletonTensors skeleton = {torch::rand({kJoints, 3}) - 0.5, torch::arange(-1, kJoints - 1)};
    parts_.add("surface, skeleton, skin", seconds_of([&] {
                 const auto decoded = decoder->forward(z, {skeleton});
                 const auto mesh = decoder->extract_meshes(decoded, /*training=*/false).front();
                 decoder->skin_weights(mesh.skin_features, skeleton, decoded.joint_features.front().features);
               }));
  }

  void sample(const std::string& name, const flow::Streams& noise, const flow::Velocities& velocities,
              double strength) {
    flow::Streams reference;
    for (std::size_t i = 0; i < measures_.size(); ++i) {
      const std::string& measure = measures_[i].name;
      std::optional<Outcome> outcome = kept_samplings_.find(name, measure);
      if (outcome && i == 0) reference = kept_samplings_.latents(name);
      if (!outcome) {
        outcome = sample_by(measures_[i], name, noise, velocities, strength, reference);
        if (i == 0) kept_samplings_.keep_latents(name, reference);
        kept_samplings_.add(name, measure, *outcome);
      }
      if (i == 0) parts_.add(name, outcome->seconds, measures_[i].sampler.steps);
      outcomes_[i].add(*outcome);
      std::printf("  %-36s %6lld passes %9.1f s, distances", measure.c_str(), static_cast<long long>(outcome->passes),
                  outcome->seconds);
      for (const double distance : outcome->distances) std::printf(" %.4f", distance);
      std::printf("\n");
      std::fflush(stdout);  // a whole table takes hours, and may be stopped
    }
  }

  // Samples a flow. @param reference becomes its latents where it is empty
  static Outcome sample_by(const Measure& measure, const std::string& name, const flow::Streams& noise,
                           const flow::Velocities& velocities, double strength, flow::Streams& reference) {
    flow::SamplerOptions options = measure.sampler;
    options.cfg_strength = strength;
    Progress progress(name + (reference.empty() ? "" : ", " + measure.name), static_cast<std::size_t>(options.steps),
                      "steps");
    flow::SamplingExtras extras;
    extras.progress = [&](std::int64_t, std::int64_t) { progress.advance(); };
    flow::Sampled sampled;
    Outcome outcome;
    outcome.seconds = seconds_of([&] { sampled = flow::sample_flow(noise, velocities, options, extras); });
    outcome.passes = sampled.passes;
    if (reference.empty()) reference = sampled.samples;
    for (std::size_t stream = 0; stream < reference.size(); ++stream) {
      outcome.distances.push_back(
          ((sampled.samples[stream] - reference[stream]).norm() / reference[stream].norm()).item<double>());
    }
    return outcome;
  }

  void print_measures() const {
    const double others = parts_.whole() - outcomes_.front().seconds;
    std::printf("\n%-36s %6s %9s %7s  %s\n", "measure", "passes", "all, min", "share",
                "distance of each stream's latents");
    for (std::size_t i = 0; i < measures_.size(); ++i) {
      const double seconds = others + outcomes_[i].seconds;
      std::printf("%-36s %6lld %9.1f %7.2f ", measures_[i].name.c_str(), static_cast<long long>(outcomes_[i].passes),
                  seconds / 60.0, seconds / parts_.whole());
      for (const double distance : outcomes_[i].distances) std::printf(" %.4f", distance);
      std::printf("\n");
    }
  }

  const Settings& settings_;
  const std::vector<Measure> measures_;
  std::vector<Outcome> outcomes_;
  KeptSamplings kept_samplings_;
  Parts parts_;
  std::vector<std::shared_ptr<torch::nn::Module>> kept_;
  Tensor tokens_;
  sparse::SupportPtr shape_, skeleton_;
};

}  // namespace

int main(int argc, char** argv) {
  anigen::start_with_openblas_core(argv);  // as the programs do
  Settings settings;
  for (int i = 1; i < argc; ++i) {
    if (settings.read(argv[i])) continue;
    std::fprintf(stderr,
                 "usage: benchmark_generation [--fp32|--int8] [--low-memory] [--steps=N [--whole] [--adams] "
                 "[--guidance-every=N]] [--measures|--measures=WORD] [--keep=FOLDER] [--voxels=PLY "
                 "--skeleton-voxels=PLY] [--blocks=N] [--threads=N] [--benchmark_out=FILE]\n");
    return 2;
  }
  settings.whole = settings.whole || settings.measures;  // what was measured is what counts
  if (settings.steps == 0) settings.steps = settings.measures ? static_cast<int>(kPublishedSteps) : 3;
  if (settings.dtypes.empty()) settings.dtypes = {torch::kBFloat16};
  try {
    if (!settings.keep.empty() && !settings.measures) throw std::runtime_error("--keep goes with --measures");
    anigen::keep_freed_memory();  // as the programs do
    at::set_num_threads(settings.threads > 0 ? settings.threads : anigen::thread_count());
    Generation(settings).run();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
