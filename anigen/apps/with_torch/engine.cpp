#include <algorithm>
#include <memory>
#include <mutex>
#include <utility>

#include "anigen/apps/with_torch/generation_request.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/engine/module.h"
#include "anigen/generate/asset_maker.h"
#include "anigen/generate/field_rigger.h"
#include "anigen/generate/run_weights.h"
#include "anigen/generate/voxel_file.h"
#include "anigen/io/image.h"
#include "anigen/nn/profile.h"
#include "anigen/vision/voxel_features.h"

namespace anigen::engine {

namespace {

generate::GenerateRequest request_of(const GeneratorOptions& options) {
  generate::GenerateRequest request = generation_request(options);
  request.pictures.matting = with_shipped_matting(request.pictures.matting, request.pictures.background);
  return request;
}

/// @throws InputError for unusable voxels, or where they leave nothing to do
void give_voxels(const GenerateOptions& options, const generate::AssetGenerator& generator,
                 generate::GenerationOptions& sampling) {
  if (options.voxels.empty()) return;
  if (sampling.voxels_alone) throw InputError("", "stop_at", "there is nothing to do: the voxels are given");
  sampling.given_voxels = generate::voxels_of_npz(options.voxels, "voxels", generator.grid(), !generator.shape_alone());
}

class Work : public GeneratorWork {
 public:
  explicit Work(const GeneratorOptions& options) : maker_(request_of(options)) {}

  Generated generate(const std::filesystem::path& image, const std::string& contents,
                     const GenerateOptions& options) override {
    const std::lock_guard<std::mutex> one_at_a_time(mutex_);
    generate::GenerationOptions sampling = sampling_options(options);
    give_voxels(options, maker_.generator(), sampling);
    generate::NamedPicture picture(image);
    picture.contents = contents;
    if (!options.mask.empty()) picture.mask = "mask";
    picture.mask_contents = options.mask;
    generate::AssetMaker::Shown shown;
    if (options.pictures) {
      shown = [&](const std::string& name, const io::Image& seen) {
        const std::vector<std::uint8_t> png = io::encode_png(seen);
        options.pictures(name, {png.begin(), png.end()});
      };
    }
    generate::MadeAsset made = maker_.make(picture, picture.name, sampling, shown);
    const generate::GenerationTimes& times = made.generated.times;
    Generated result;
    result.asset = std::move(made.finished.asset);
    result.asset.name = picture.name;
    result.notices = std::move(made.notices);
    result.voxels = generate::npz_of_voxels(made.generated.voxels);
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

/// On as many threads as the process works on already: a program may have been told how many.
void set_up_computing() { nn::set_up_computing(thread_count()); }

std::unique_ptr<GeneratorWork> generator(const GeneratorOptions& options) {
  set_up_computing();
  return std::make_unique<Work>(options);
}

rigging::SureJoints load_sure_joints() {
  set_up_computing();
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

rigging::SureJoints loaded_sure_joints() {
  static const rigging::SureJoints joints = load_sure_joints();
  return joints;
}

}  // namespace

/// The entry that engine_module() looks for.
extern "C" __attribute__((visibility("default"))) const EngineModule* anigen_engine_module() {
  static const EngineModule module{generator, loaded_sure_joints, vision::make_feature_extractor};
  return &module;
}

}  // namespace anigen::engine
