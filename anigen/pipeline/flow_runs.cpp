#include "anigen/pipeline/flow_runs.h"

#include <algorithm>
#include <string>
#include <system_error>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/json.h"
#include "anigen/models/sparse_structure_runs.h"
#include "anigen/models/structured_latent_flow_runs.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;

struct Run {
  fs::path folder;
  bool structure = false, latents = false, counts_joints = false;
};

/// Run folders directly in a folder.
void add_runs(const fs::path& parent, std::vector<Run>& runs) {
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(parent, error)) {
    const fs::path config = entry.path() / "config.json";
    if (!fs::is_regular_file(config, error) || !fs::is_directory(entry.path() / "ckpts", error)) continue;
    const Json json = read_json(config);
    if (!json.is_object() || !json.contains("models") || !json["models"].is_object()) continue;
    Run run;
    run.folder = entry.path();
    for (const auto& [name, model] : json["models"].items()) {
      if (!model.is_object() || !model.contains("name") || !model["name"].is_string()) continue;
      run.structure |= model["name"] == models::kSparseStructureFlowClass;
      run.latents |= model["name"] == models::kStructuredLatentFlowClass ||
                     model["name"] == models::kPlainStructuredLatentFlowClass;
      if (model.contains("args") && model["args"].is_object() && model["args"].contains("use_joint_num_cond")) {
        run.counts_joints |= model["args"]["use_joint_num_cond"] == true;
      }
    }
    if (run.structure || run.latents) runs.push_back(run);
  }
}

fs::path chosen(const fs::path& folder, const std::vector<fs::path>& found, const std::string& usual,
                const std::string& what) {
  if (found.empty()) throw InputError(folder.string(), "", "holds no run of " + what);
  if (found.size() == 1) return found.front();
  for (const fs::path& run : found) {
    if (run.filename() == usual) return run;
  }
  std::string names;
  for (const fs::path& run : found) names += (names.empty() ? "" : ", ") + run.filename().string();
  throw InputError(folder.string(), "", "holds several runs of " + what + " (" + names + "), none called " + usual);
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
                             "the first flow (" + std::string(models::kSparseStructureFlowClass) + ")");
  }
  if (found.latents.empty()) {
    found.latents = chosen(folder, latents, joint_count ? "slat_flow_control" : "slat_flow_auto",
                           std::string("the second flow (") + models::kStructuredLatentFlowClass + ")" +
                               (joint_count ? " that was told numbers of joints" : ""));
  }
  return found;
}

}  // namespace anigen::pipeline
