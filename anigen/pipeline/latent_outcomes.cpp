#include "anigen/pipeline/latent_outcomes.h"

#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/file_lock.h"
#include "anigen/core/version.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;

/// @return null when there is none, or it is damaged
Json read_or_null(const fs::path& file) {
  std::error_code error;
  if (!fs::exists(file, error)) return nullptr;
  try {
    return read_json(file);
  } catch (const InputError&) {
    return nullptr;
  }
}

bool is_of(const Json& run, const Json& encoder) {
  return run.is_object() && run.contains("encoder") && run.at("encoder") == encoder;
}

void write(const fs::path& file, const Json& json) {
  write_file_atomically(file, json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

}  // namespace

LatentOutcomes::LatentOutcomes(const fs::path& data, const std::string& column)
    : folder_(dataset_lock_file(data).parent_path() / ("encode-" + column)) {}

std::map<std::string, LatentOutcome> LatentOutcomes::encoded_by(const Json& encoder) const {
  std::map<std::string, LatentOutcome> encoded;
  if (!is_of(read_or_null(run_file()), encoder)) return encoded;
  std::error_code error;
  for (fs::directory_iterator entry(folder_ / "assets", error), end; !error && entry != end; entry.increment(error)) {
    const std::string id = entry->path().stem().string();
    if (id.find(".tmp-") != std::string::npos) continue;  // what a killed process left
    const std::optional<LatentOutcome> outcome = read(id);
    if (outcome && outcome->failure.empty() && !outcome->inputs.empty()) encoded[id] = *outcome;
  }
  return encoded;
}

void LatentOutcomes::begin(const Json& encoder, const std::set<std::string>& kept) const {
  std::error_code error;
  fs::remove_all(folder_, error);
  if (error) throw Error(folder_.string() + ": cannot be removed: " + error.message());
  pipeline::write(run_file(), {{"encoder", encoder}, {"kept", kept}, {"commit", commit()}});
}

bool LatentOutcomes::join(const Json& encoder, std::set<std::string>& kept) const {
  const Json run = read_or_null(run_file());
  if (!is_of(run, encoder) || run.value("commit", Json()) != commit()) return false;
  kept = run.at("kept").get<std::set<std::string>>();
  return true;
}

std::optional<LatentOutcome> LatentOutcomes::read(const std::string& id) const {
  const Json json = read_or_null(file(id));
  if (!json.is_object()) return std::nullopt;
  try {
    return LatentOutcome{json.at("inputs").get<std::string>(), json.at("failure").get<std::string>(),
                         latent_moments_from_json(json.at("shape")), latent_moments_from_json(json.at("skeleton")),
                         json.value("commit", "")};
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

void LatentOutcomes::write(const std::string& id, const LatentOutcome& outcome) const {
  pipeline::write(file(id), {{"inputs", outcome.inputs},
                             {"failure", outcome.failure},
                             {"shape", to_json(outcome.shape)},
                             {"skeleton", to_json(outcome.skeleton)},
                             {"commit", outcome.commit}});
}

bool LatentOutcomes::concluded() const {
  std::error_code error;
  return fs::exists(folder_ / "concluded", error);
}

void LatentOutcomes::set_concluded() const { write_file_atomically(folder_ / "concluded", ""); }

}  // namespace anigen::pipeline
