#include "anigen/pipeline/run_weights.h"

#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "anigen/core/config_file.h"
#include "anigen/core/error.h"
#include "anigen/io/torch_archive.h"
#include "anigen/models/run_model.h"
#include "anigen/models/skin_autoencoder.h"
#include "anigen/models/sparse_structure_decoder.h"
#include "anigen/models/sparse_structure_encoder.h"
#include "anigen/models/sparse_structure_flow.h"
#include "anigen/models/sparse_structure_runs.h"
#include "anigen/models/state_dict.h"
#include "anigen/models/structured_latent_decoder.h"
#include "anigen/models/structured_latent_encoder.h"
#include "anigen/models/structured_latent_flow.h"
#include "anigen/models/structured_latent_flow_runs.h"
#include "anigen/models/structured_latent_runs.h"
#include "anigen/pipeline/anymate_models.h"
#include "anigen/pipeline/rignet_models.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;
using ModulePtr = std::shared_ptr<torch::nn::Module>;
using Builder = std::function<ModulePtr(const models::RunModel&)>;

template <typename Model, typename Options>
ModulePtr built(const models::RunModel& found) {
  return Model(Options::from_json(found.args, found.config.string(), found.pointer), nn::Init::kNone).ptr();
}

const std::map<std::string, Builder>& builders() {
  static const std::map<std::string, Builder> kBuilders = {
      {"SkinAutoEncoder", built<models::SkinAutoEncoder, models::SkinAutoEncoderOptions>},
      {kAnymateModelClass, built<models::anymate::AnymateModel, models::anymate::ModelOptions>},
      {kRignetModelClass, built<models::rignet::RignetModel, models::rignet::RignetOptions>},
      {models::kSparseStructureEncoderClass,
       built<models::SparseStructureEncoder, models::SparseStructureEncoderOptions>},
      {models::kSparseStructureDecoderClass,
       built<models::SparseStructureDecoder, models::SparseStructureDecoderOptions>},
      {models::kSparseStructureFlowClass, built<models::SparseStructureFlow, models::SparseStructureFlowOptions>},
      {models::kStructuredLatentEncoderClass,
       built<models::StructuredLatentEncoder, models::StructuredLatentEncoderOptions>},
      {models::kStructuredLatentDecoderClass,
       built<models::StructuredLatentDecoder, models::StructuredLatentDecoderOptions>},
      {models::kStructuredLatentFlowClass, built<models::StructuredLatentFlow, models::StructuredLatentFlowOptions>},
      {models::kPlainStructuredLatentFlowClass,
       built<models::StructuredLatentFlow, models::StructuredLatentFlowOptions>}};
  return kBuilders;
}

/// The model with the file that generation would read: of a flow by its rules, of an auto-encoder the published
/// default `final`, which stands for the newest where there is none of that name.
models::RunModel found_as_generation_does(const fs::path& run, const std::string& class_name) {
  const std::set<std::string> flows = {models::kSparseStructureFlowClass, models::kStructuredLatentFlowClass,
                                       models::kPlainStructuredLatentFlowClass};
  return flows.count(class_name) > 0 ? models::find_flow_model(run, {class_name})
                                     : models::find_run_model(run, class_name, "final");
}

void note_keys(Json& json, const char* what, const std::vector<std::string>& keys) {
  if (!keys.empty()) json[what] = {{"count", keys.size()}, {"first", keys.front()}};
}

Json compared(const torch::nn::Module& model, const io::NamedArrays& arrays) {
  std::map<std::string, const std::vector<std::int64_t>*> found;
  for (const auto& [key, array] : arrays) found[key] = &array.shape;
  std::vector<std::string> missing, misshapen, unexpected;
  std::set<std::string> known;
  std::int64_t parameters = 0;
  const std::vector<models::StateEntry> entries = models::state_entries(model);
  for (const models::StateEntry& entry : entries) {
    known.insert(entry.key);
    parameters += entry.is_buffer ? 0 : entry.tensor.numel();
    const auto there = found.find(entry.key);
    if (there == found.end()) {
      missing.push_back(entry.key);
    } else if (*there->second != entry.tensor.sizes().vec()) {
      misshapen.push_back(entry.key);
    }
  }
  for (const auto& [key, array] : arrays) {
    if (known.count(key) == 0) unexpected.push_back(key);
  }
  Json json = {{"tensors", entries.size()},
               {"parameters", parameters},
               {"complete", missing.empty() && misshapen.empty() && unexpected.empty()}};
  note_keys(json, "missing", missing);
  note_keys(json, "misshapen", misshapen);
  note_keys(json, "unexpected", unexpected);
  return json;
}

}  // namespace

Json describe_weights(const fs::path& run) {
  const Json config = load_config(run / "config.json");
  Json result = Json::object();
  if (!config.contains("models") || !config["models"].is_object()) {
    throw InputError((run / "config.json").string(), "/models", "describes no models");
  }
  for (const auto& [name, model] : config["models"].items()) {
    const bool is_named = model.is_object() && model.contains("name") && model["name"].is_string();
    const std::string class_name = is_named ? model["name"].get<std::string>() : "";
    Json& one = result[name] = {{"class", class_name}};
    const auto builder = builders().find(class_name);
    if (builder == builders().end()) {
      one["complete"] = false;
      one["problem"] = "a class of models that is not known";
      continue;
    }
    try {
      const models::RunModel found = found_as_generation_does(run, class_name);
      one["checkpoint"] = found.checkpoint.filename().string();
      one.update(compared(*builder->second(found), io::read_state_dict(found.checkpoint)));
    } catch (const InputError& error) {
      one["complete"] = false;
      one["problem"] = error.what();
    }
  }
  return result;
}

std::string first_incomplete(const Json& weights) {
  for (const auto& [model, found] : weights.items()) {
    if (found["complete"]) continue;
    if (found.contains("problem")) return model + ": " + found["problem"].get<std::string>();
    for (const char* what : {"missing", "misshapen", "unexpected"}) {
      if (!found.contains(what)) continue;
      return model + ", " + found["checkpoint"].get<std::string>() + ": " + found[what]["count"].dump() + " " + what +
             " tensors, the first " + found[what]["first"].get<std::string>();
    }
  }
  return "";
}

}  // namespace anigen::pipeline
