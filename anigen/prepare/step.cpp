#include "anigen/prepare/step.h"

#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/prepare/steps.h"

namespace anigen::prepare {

namespace {

/// Of the form of the file itself; what steps make is versioned by each step.
constexpr int kFormat = 2;

}  // namespace

const Json& StepRecords::columns(const std::string& step) const {
  static const Json none = Json::object();
  const auto found = steps.find(step);
  return found == steps.end() ? none : found->second.columns;
}

std::string StepRecords::fingerprint(const std::string& step, int version, const Json& options,
                                     const std::vector<std::string>& inputs) const {
  Json parts = Json::array({step, version, options});
  for (const std::string& input : inputs) {
    const auto found = steps.find(input);
    if (found == steps.end()) throw Error("step " + step + " comes before its input " + input);
    parts.push_back(found->second.fingerprint);
  }
  return sha256(parts.dump());
}

void StepRecords::drop_stale() {
  const auto stale = [&](const std::string& name, const StepResult& result) {
    for (const std::string& input : result.inputs) {
      if (!has(input)) return true;
    }
    return result.fingerprint != fingerprint(name, result.version, result.options, result.inputs);
  };
  for (bool changed = true; changed;) {
    changed = false;
    for (auto step = steps.begin(); step != steps.end();) {
      const bool drop = stale(step->first, step->second);
      changed = changed || drop;
      step = drop ? steps.erase(step) : std::next(step);
    }
  }
}

StepRecords read_step_records(const std::filesystem::path& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return {};
  try {
    const Json json = read_json(file);
    if (json.at("format").get<int>() != kFormat) return {};
    StepRecords records;
    for (const auto& [name, step] : json.at("steps").items()) {
      StepResult result;
      step.at("fingerprint").get_to(result.fingerprint);
      step.at("version").get_to(result.version);
      step.at("inputs").get_to(result.inputs);
      result.options = step.at("options");
      step.at("files").get_to(result.files);
      step.at("bytes").get_to(result.bytes);
      result.columns = step.at("columns");
      result.commit = step.value("commit", "");
      if (!result.columns.is_object()) return {};
      records.steps[name] = std::move(result);
    }
    return records;
  } catch (const InputError&) {
    return {};
  } catch (const Json::exception&) {
    return {};
  }
}

void write_step_records(const std::filesystem::path& file, const std::string& id, const StepRecords& records) {
  Json steps = Json::object();
  for (const auto& [name, result] : records.steps) {
    steps[name] = {{"fingerprint", result.fingerprint}, {"version", result.version}, {"options", result.options},
                   {"inputs", result.inputs},           {"files", result.files},     {"bytes", result.bytes},
                   {"columns", result.columns},         {"commit", result.commit}};
  }
  const Json json = {{"format", kFormat}, {"id", id}, {"steps", steps}};
  // Names inside some files are not UTF-8; a record is, whatever it quotes.
  write_file_atomically(file, json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

AssetJob::AssetJob(AssetPlaces places, std::function<Asset()> load)
    : places_(std::move(places)), load_(std::move(load)) {}

const Asset& AssetJob::asset() {
  if (!asset_) asset_ = load_();
  return *asset_;
}

const std::vector<geometry::Voxel>& AssetJob::surface_voxels(int resolution) {
  if (!voxels_) voxels_ = read_voxel_ply(places_.surface_voxels(), resolution);
  return *voxels_;
}

namespace fs = std::filesystem;

void Step::clear(const AssetPlaces& places) const {
  for (const fs::path& file : outputs(places, options())) {
    std::error_code ignored;
    fs::remove(file, ignored);
  }
}

bool measure_files(const std::vector<fs::path>& files, StepResult& result) {
  result.files = files.size();
  result.bytes = 0;
  for (const fs::path& file : files) {
    std::error_code error;
    const std::uintmax_t size = fs::file_size(file, error);
    if (error) return false;
    result.bytes += size;
  }
  return true;
}

bool up_to_date(const Step& step, const AssetPlaces& places, const StepRecords& records, bool any_options) {
  const auto found = records.steps.find(step.name());
  if (found == records.steps.end()) return false;
  for (const std::string& input : step.inputs()) {
    if (!records.has(input)) return false;
  }
  const Json options = any_options ? found->second.options : step.options();
  if (found->second.fingerprint != records.fingerprint(step.name(), step.version(), options, step.inputs())) {
    return false;
  }
  StepResult now;
  return measure_files(step.outputs(places, options), now) && now.files == found->second.files &&
         now.bytes == found->second.bytes;
}

namespace {

constexpr char kFeatures[] = "features/";
constexpr int kAnyResolution = 64;  // decides what is in the files, not where they lie

std::vector<std::unique_ptr<Step>> known_steps() {
  std::vector<std::unique_ptr<Step>> steps;
  steps.push_back(std::make_unique<SkeletonStep>());
  steps.push_back(std::make_unique<KeepAssetStep>());
  steps.push_back(std::make_unique<VoxelStep>(kAnyResolution));
  steps.push_back(std::make_unique<ViewStep>(ViewSettings{}));
  steps.push_back(std::make_unique<ConditionViewStep>(ViewSettings{}));
  return steps;
}

}  // namespace

std::vector<std::filesystem::path> recorded_files(const std::string& step, const Json& options,
                                                  const AssetPlaces& places) {
  static const std::vector<std::unique_ptr<Step>> steps = known_steps();
  if (step.rfind(kFeatures, 0) == 0) return {places.features(step.substr(sizeof kFeatures - 1))};
  for (const std::unique_ptr<Step>& known : steps) {
    if (known->name() == step) return known->outputs(places, options);
  }
  return {};
}

void reset_peak_memory() {
  // 5 resets the high-water mark: proc(5), /proc/[pid]/clear_refs.
  std::ofstream("/proc/self/clear_refs") << "5";
}

std::uint64_t peak_memory_bytes() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    if (word != "VmHWM:") continue;
    std::uint64_t kibibytes = 0;
    status >> kibibytes;
    return kibibytes << 10;
  }
  return 0;
}

}  // namespace anigen::prepare
