#include "anigen/generate/run_weights.h"

#include <dlfcn.h>
#include <algorithm>
#include <cstdlib>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <system_error>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/run_folder.h"
#include "anigen/core/text.h"
#include "anigen/generate/anymate_rigger.h"
#include "anigen/generate/rignet_rigger.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/nn/state_dict.h"
#include "anigen/skin_correction/network.h"
#include "anigen/skin_field/skin_autoencoder.h"
#include "anigen/sparse_structure/autoencoder.h"
#include "anigen/sparse_structure/flow.h"
#include "anigen/structured_latent/decoder.h"
#include "anigen/structured_latent/encoder.h"
#include "anigen/structured_latent/flow.h"
#include "anigen/structured_latent/sampling.h"
#include "anigen/vision/matting.h"
#include "anigen/vision/picture_estimator.h"

namespace anigen::generate {

namespace fs = std::filesystem;

namespace {

struct Run {
  fs::path folder;
  bool structure = false, latents = false, counts_joints = false;
};

/// Run folders directly in a folder.
void add_runs(const fs::path& parent, std::vector<Run>& runs) {
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(parent, error)) {
    const RunFolder folder{entry.path()};
    if (!folder.has_config() || !folder.has_checkpoints()) continue;
    const Json json = read_json(folder.config());
    if (!json.is_object() || !json.contains("models") || !json["models"].is_object()) continue;
    Run run;
    run.folder = entry.path();
    for (const auto& [name, model] : json["models"].items()) {
      if (!model.is_object() || !model.contains("name") || !model["name"].is_string()) continue;
      run.structure |= model["name"] == sparse_structure::kSparseStructureFlowClass;
      run.latents |= model["name"] == structured_latent::kStructuredLatentFlowClass ||
                     model["name"] == structured_latent::kPlainStructuredLatentFlowClass;
      if (model.contains("args") && model["args"].is_object() && model["args"].contains("use_joint_num_cond"))
        run.counts_joints |= model["args"]["use_joint_num_cond"] == true;
    }
    if (run.structure || run.latents) runs.push_back(run);
  }
}

fs::path chosen(const fs::path& folder, const std::vector<fs::path>& found, const std::string& usual,
                const std::string& what) {
  if (found.empty()) {
    throw InputError(folder.string(), "",
                     "holds no run of " + what + "; name a folder that does with --runs, or runs with --ss-flow and " +
                         "--slat-flow");
  }
  if (found.size() == 1) return found.front();
  for (const fs::path& run : found) {
    if (run.filename() == usual) return run;
  }
  const std::string names = joined(found, ", ", [](const fs::path& run) { return run.filename().string(); });
  throw InputError(folder.string(), "", "holds several runs of " + what + " (" + names + "), none called " + usual);
}

using ModulePtr = std::shared_ptr<torch::nn::Module>;
using Builder = std::function<ModulePtr(const nn::RunModel&)>;

template <typename Model>
ModulePtr built(const nn::RunModel& found) {
  using Options = std::decay_t<decltype(std::declval<Model&>()->options())>;
  return Model(Options::from_json(found.args, found.config.string(), found.pointer), nn::Init::kNone).ptr();
}

const std::map<std::string, Builder> kBuilders = {
    {"SkinAutoEncoder", built<skin_field::SkinAutoEncoder>},
    {kAnymateModelClass, built<anymate::AnymateModel>},
    {kRignetModelClass, built<rignet::RignetModel>},
    {vision::kPictureEstimatorClass, built<vision::PictureEstimator>},
    {vision::kMattingUNetClass, built<vision::MattingUNet>},
    {skin_correction::kSkinCorrectionClass, built<skin_correction::SkinCorrection>},
    {sparse_structure::kSparseStructureEncoderClass, built<sparse_structure::SparseStructureEncoder>},
    {sparse_structure::kSparseStructureDecoderClass, built<sparse_structure::SparseStructureDecoder>},
    {sparse_structure::kSparseStructureFlowClass, built<sparse_structure::SparseStructureFlow>},
    {structured_latent::kStructuredLatentEncoderClass, built<structured_latent::StructuredLatentEncoder>},
    {structured_latent::kStructuredLatentDecoderClass, built<structured_latent::StructuredLatentDecoder>},
    {structured_latent::kStructuredLatentFlowClass, built<structured_latent::StructuredLatentFlow>},
    {structured_latent::kPlainStructuredLatentFlowClass, built<structured_latent::StructuredLatentFlow>}};

/// The model with the file that generation would read: of a flow by its rules, of an auto-encoder the published
/// default `final`, which stands for the newest where there is none of that name.
nn::RunModel found_as_generation_does(const fs::path& run, const std::string& class_name) {
  const std::set<std::string> flows = {sparse_structure::kSparseStructureFlowClass,
                                       structured_latent::kStructuredLatentFlowClass,
                                       structured_latent::kPlainStructuredLatentFlowClass};
  return flows.count(class_name) > 0 ? nn::find_flow_model(run, {class_name})
                                     : nn::find_run_model(run, class_name, "final");
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
  const std::vector<nn::StateEntry> entries = nn::state_entries(model);
  for (const nn::StateEntry& entry : entries) {
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

constexpr const char* kWeightsVariable = "ANIGEN_WEIGHTS";

fs::path own_module_folder() {
  std::error_code error;
  Dl_info self{};
  if (::dladdr(reinterpret_cast<void*>(&own_module_folder), &self) == 0 || self.dli_fname == nullptr) return {};
  return fs::canonical(self.dli_fname, error).parent_path();
}

// Empty when none is there. @param places set to those that were looked at
fs::path find_shipped_weights(std::vector<fs::path>& places) {
  constexpr const char* kFolder = "weights/anigen-small";
  std::error_code error;
  if (const char* named = std::getenv(kWeightsVariable); named != nullptr && *named != '\0') {
    if (fs::is_directory(named, error)) return named;
    throw InputError(named, kWeightsVariable, "is no folder");
  }
  const fs::path program = fs::read_symlink("/proc/self/exe", error).parent_path();
  constexpr int kLevels = 4;  // build/release/bin lies three below the sources
  fs::path above = program;
  for (int level = 0; level < kLevels; ++level, above = above.parent_path()) places.push_back(above / kFolder);
  places.push_back(program.parent_path() / "share/anigen" / kFolder);
  // Below the prefix of the module that this is in, <prefix>/lib/<architecture>/anigen, for programs of others.
  fs::path prefix = own_module_folder();
  for (int level = 0; level < kLevels; ++level, prefix = prefix.parent_path())
    if (level > 1) places.push_back(prefix / "share/anigen" / kFolder);
  places.push_back(fs::path("/usr/share/anigen") / kFolder);
  for (const fs::path& place : places) {
    if (fs::is_directory(place, error)) return place;
  }
  return {};
}

// One of these weights by its name; empty when there are no weights or none of it.
fs::path shipped_run(const char* name) {
  std::vector<fs::path> places;
  const fs::path weights = find_shipped_weights(places);
  if (weights.empty()) return {};
  const RunFolder run{weights / name};
  return run.has_config() && run.has_checkpoints() ? run.root : fs::path();
}

}  // namespace

FlowRuns find_flow_runs(const fs::path& folder, bool joint_count, const FlowRuns& known) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) throw InputError(folder.string(), "", "there is no such folder");
  std::vector<Run> runs;
  for (const char* below : {"", "anigen", "ckpts/anigen"}) {
    if (runs.empty()) add_runs(folder / below, runs);
  }
  std::sort(runs.begin(), runs.end(), [](const Run& a, const Run& b) { return a.folder < b.folder; });
  std::vector<fs::path> structure, latents;
  for (const Run& run : runs) {
    if (run.structure) structure.push_back(run.folder);
    if (run.latents && (!joint_count || run.counts_joints)) latents.push_back(run.folder);
  }
  FlowRuns found = known;
  if (found.structure.empty()) {
    found.structure = chosen(folder, structure, "ss_flow_solo",
                             "the first flow (" + std::string(sparse_structure::kSparseStructureFlowClass) + ")");
  }
  if (found.latents.empty()) {
    found.latents = chosen(folder, latents, joint_count ? "slat_flow_control" : "slat_flow_auto",
                           std::string("the second flow (") + structured_latent::kStructuredLatentFlowClass + ")" +
                               (joint_count ? " that was told numbers of joints" : ""));
  }
  return found;
}

fs::path shipped_weights() {
  std::vector<fs::path> places;
  const fs::path found = find_shipped_weights(places);
  if (!found.empty()) return found;
  throw InputError("", kWeightsVariable,
                   "no weights come with this program: none of " +
                       joined(places, ", ", [](const fs::path& place) { return place.string(); }) +
                       " exists. Name the runs of both flows with --ss-flow and --slat-flow, or the folder of both "
                       "with --runs or in this variable");
}

fs::path shipped_matting() { return shipped_run("matting"); }

fs::path shipped_skin_correction() { return shipped_run("skin_correction"); }

FlowRuns shipped_rig_flows() {
  const FlowRuns found{shipped_run("rig/ss_flow"), shipped_run("rig/slat_flow")};
  return found.structure.empty() || found.latents.empty() ? FlowRuns() : found;
}

Json describe_weights(const fs::path& run) {
  const Json config = load_config(RunFolder{run}.config());
  Json result = Json::object();
  if (!config.contains("models") || !config["models"].is_object()) {
    throw InputError(RunFolder{run}.config().string(), "/models", "describes no models");
  }
  for (const auto& [name, model] : config["models"].items()) {
    const bool is_named = model.is_object() && model.contains("name") && model["name"].is_string();
    const std::string class_name = is_named ? model["name"].get<std::string>() : "";
    Json& one = result[name] = {{"class", class_name}};
    const auto builder = kBuilders.find(class_name);
    if (builder == kBuilders.end()) {
      one["complete"] = false;
      one["problem"] = "a class of models that is not known";
      continue;
    }
    try {
      const nn::RunModel found = found_as_generation_does(run, class_name);
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

}  // namespace anigen::generate
