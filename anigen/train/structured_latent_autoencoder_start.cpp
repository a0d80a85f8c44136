// What the two models of the structured latents begin with.
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/torch_archive.h"
#include "anigen/models/freezing.h"
#include "anigen/models/run_model.h"
#include "anigen/models/structured_latent_runs.h"
#include "anigen/train/structured_latent_autoencoder_stage.h"

namespace anigen::train {
namespace {

constexpr const char* kSkinAutoEncoderClass = "SkinAutoEncoder";

struct SkinWeightsFile {
  io::NamedArrays arrays;
  std::string source;
};

// The part of a trained SkinAE that belongs into a model; published and own checkpoints name it alike.
SkinWeightsFile skin_weights_of_run(const std::filesystem::path& run, const std::string& part) {
  const models::RunModel found = models::find_run_model(run, kSkinAutoEncoderClass);
  SkinWeightsFile file{{}, found.checkpoint.string()};
  for (auto& [key, array] : io::read_state_dict(found.checkpoint)) {
    if (key.rfind(part + ".", 0) == 0) file.arrays.emplace_back(key, std::move(array));
  }
  if (file.arrays.empty()) throw InputError(file.source, "", "holds no " + part);
  return file;
}

}  // namespace

void StructuredLatentAutoEncoderStage::start_model(torch::nn::Module& model, bool pretrained, const char* class_name,
                                                   const std::string& skin_name, const std::string& skin_part,
                                                   std::set<std::string> loaded) {
  const bool wants_skin = options_.variant.needs_skin_ae();
  std::vector<PretrainedFile> files;
  if (pretrained && options_.warm_start.enabled) files.push_back({class_name, ""});
  SkinWeightsFile skin;
  if (wants_skin && options_.skin_ae_run.empty()) files.push_back({skin_name, skin_part});
  if (wants_skin && !options_.skin_ae_run.empty()) {
    skin = skin_weights_of_run(options_.skin_ae_run, skin_part);
    for (const auto& entry : skin.arrays) loaded.insert(entry.first);
  }
  if (!wants_skin) {
    // The silent encoder is as it shall be.
    for (const std::string& key : models::frozen_parameters(model)) {
      if (key.rfind("skin_encoder.", 0) == 0) loaded.insert(key);
    }
  }
  // With "warm_start": "none" the SkinAE still is a trained one; only the shape begins anew.
  WarmStartOptions reading = options_.warm_start;
  reading.enabled = true;
  if (!files.empty() || pretrained) load_pretrained(model, files, reading, std::move(loaded));
  if (!skin.arrays.empty()) load_matching(model, skin.arrays, skin.source);
}

void StructuredLatentAutoEncoderStage::warm_start(const LoadedKeys& finetuned) {
  const auto& encoder = coders_.encoder;
  const auto& decoder = coders_.decoder;
  start_model(*encoder_, encoder.use_pretrain_branch, models::kStructuredLatentEncoderClass, encoder.skin_ae_name,
              "skin_encoder", keys_of(finetuned, "encoder"));
  start_model(*decoder_, decoder.use_pretrain_branch, models::kStructuredLatentDecoderClass, decoder.skin_ae_name,
              "skin_decoder", keys_of(finetuned, "decoder"));
  if (!options_.variant.needs_skin_ae()) silence_skin_encoder();  // whatever a file of weights holds of it
}

}  // namespace anigen::train
