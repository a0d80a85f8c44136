#include <algorithm>
#include <memory>
#include <mutex>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/engine/module.h"
#include "anigen/generate/asset_maker.h"
#include "anigen/generate/field_rigger.h"
#include "anigen/generate/run_weights.h"
#include "anigen/nn/profile.h"

namespace anigen::engine {

namespace {

generate::GenerateRequest request_of(const GeneratorOptions& options) {
  generate::GenerateRequest request;
  const generate::FlowRuns named{options.structure_flow, options.latent_flow};
  const bool both = !named.structure.empty() && !named.latents.empty();
  const generate::FlowRuns runs =
      both ? named
           : generate::find_flow_runs(options.runs.empty() ? generate::shipped_weights() : options.runs, false, named);
  request.models.structure_flow = runs.structure;
  request.models.latent_flow = runs.latents;
  request.models.device = options.device;
  request.models.low_memory = options.low_memory;
  if (options.precision == "bf16") {
    request.models.precision = torch::kBFloat16;
  } else if (options.precision != "fp32") {
    throw InputError("", "precision", "\"" + options.precision + "\" is neither fp32 nor bf16");
  }
  using generate::Background;
  request.pictures.background = generate::parse_background(options.background);
  if (request.pictures.background == Background::kAuto || request.pictures.background == Background::kNetwork)
    request.pictures.matting.network = generate::shipped_matting();
  request.picture_colors = options.image_colors;
  return request;
}

class Work : public GeneratorWork {
 public:
  explicit Work(const GeneratorOptions& options) : maker_(request_of(options)) {}

  Generated generate(const std::filesystem::path& image, const std::string& contents,
                     const GenerateOptions& options) override {
    const std::lock_guard<std::mutex> one_at_a_time(mutex_);
    generate::GenerationOptions sampling;
    sampling.seed = options.seed;
    sampling.joints = options.joints;
    sampling.structure.steps = options.structure_steps;
    sampling.latents.steps = options.latent_steps;
    // The configs' strength is the guidance scale less 1.
    if (options.structure_guidance) sampling.structure.cfg_strength = *options.structure_guidance - 1;
    if (options.latent_guidance) sampling.latents.cfg_strength = *options.latent_guidance - 1;
    generate::NamedPicture picture(image);
    picture.contents = contents;
    generate::MadeAsset made = maker_.make(picture, picture.name, sampling);
    const generate::GenerationTimes& times = made.generated.times;
    Generated result;
    result.asset = std::move(made.finished.asset);
    result.asset.name = picture.name;
    result.notices = std::move(made.notices);
    result.seconds = {{"condition", times.condition},
                      {"structure", times.structure},
                      {"latents", times.latents},
                      {"decode", times.decode}};
    return result;
  }

 private:
  std::mutex mutex_;
  generate::AssetMaker maker_;
};

std::unique_ptr<GeneratorWork> generator(const GeneratorOptions& options) {
  nn::set_up_computing(0);
  return std::make_unique<Work>(options);
}

rigging::SureJoints load_sure_joints() {
  nn::set_up_computing(0);
  const generate::FlowRuns flows = generate::shipped_rig_flows();
  if (flows.structure.empty()) {
    return [](const io::RiggedShape&, std::string& why_not) -> std::optional<rigging::ProposedJoints> {
      why_not = "there are no weights of flows";
      return std::nullopt;
    };
  }
  generate::FieldRigger::Request request;
  request.flows = flows;
  const auto sure = generate::FieldRigger::steps(std::make_shared<generate::FieldRigger>(request)).sure;
  const auto mutex = std::make_shared<std::mutex>();
  return [sure, mutex](const io::RiggedShape& shape, std::string& why_not) {
    const std::lock_guard<std::mutex> one_at_a_time(*mutex);
    return sure(shape, why_not);
  };
}

rigging::SureJoints sure_joints() {
  static const rigging::SureJoints joints = load_sure_joints();
  return joints;
}

}  // namespace

/// The entry that engine_module() looks for.
extern "C" __attribute__((visibility("default"))) const EngineModule* anigen_engine_module() {
  static const EngineModule module{generator, sure_joints};
  return &module;
}

}  // namespace anigen::engine
