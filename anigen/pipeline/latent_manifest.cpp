#include "anigen/pipeline/latent_manifest.h"

#include <exception>
#include <system_error>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/json.h"
#include "anigen/core/log.h"
#include "anigen/core/sha256.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kSaveEvery = 256;

}  // namespace

LatentManifest::LatentManifest(const fs::path& folder, std::string encoder)
    : file_(folder / "encoded.json"), encoder_(std::move(encoder)) {
  std::error_code error;
  if (!fs::exists(file_, error)) return;
  try {
    const Json json = read_json(file_);
    if (json.at("encoder") != encoder_) return;
    for (const auto& [id, inputs] : json.at("assets").items()) inputs_[id] = inputs.get<std::string>();
  } catch (const std::exception& problem) {
    log::warn("{}: {}; everything is encoded again", file_.string(), problem.what());
    inputs_.clear();
  }
}

LatentManifest::~LatentManifest() {
  if (unsaved_ == 0) return;
  try {
    save();
  } catch (const std::exception& problem) {
    log::warn("{}; the latents of this run will be made again", problem.what());
  }
}

bool LatentManifest::up_to_date(const std::string& id, const std::string& inputs) const {
  const auto entry = inputs_.find(id);
  return entry != inputs_.end() && entry->second == inputs;
}

void LatentManifest::forget(const std::vector<std::string>& ids) {
  for (const std::string& id : ids) inputs_.erase(id);
  save();
}

void LatentManifest::add(const std::string& id, const std::string& inputs) {
  inputs_[id] = inputs;
  if (++unsaved_ >= kSaveEvery) save();
}

void LatentManifest::save() {
  Json assets = Json::object();
  for (const auto& [id, inputs] : inputs_) assets[id] = inputs;
  const Json json = {{"encoder", encoder_}, {"assets", assets}};
  write_file_atomically(file_, json.dump(1) + "\n");
  unsaved_ = 0;
}

std::string fingerprint_of_files(const std::vector<fs::path>& files) {
  Sha256 digest;
  for (const fs::path& file : files) {
    const std::string bytes = read_file(file);
    digest.update(std::to_string(bytes.size()) + ":");  // so that bytes cannot move from one file to the next
    digest.update(bytes);
  }
  return digest.finish();
}

}  // namespace anigen::pipeline
