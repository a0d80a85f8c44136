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
    for (const auto& [id, asset] : json.at("assets").items()) {
      if (asset.is_string()) {  // as programs wrote it that recorded no commit
        entries_[id] = {asset.get<std::string>(), ""};
      } else {
        entries_[id] = {asset.at("inputs").get<std::string>(), asset.at("commit").get<std::string>()};
      }
    }
  } catch (const std::exception& problem) {
    log::warn("{}: {}; everything is encoded again", file_.string(), problem.what());
    entries_.clear();
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
  const auto entry = entries_.find(id);
  return entry != entries_.end() && entry->second.inputs == inputs;
}

std::string LatentManifest::commit_of(const std::string& id) const {
  const auto entry = entries_.find(id);
  return entry == entries_.end() ? "" : entry->second.commit;
}

void LatentManifest::forget(const std::vector<std::string>& ids) {
  for (const std::string& id : ids) entries_.erase(id);
  save();
}

void LatentManifest::add(const std::string& id, const std::string& inputs, const std::string& commit) {
  entries_[id] = {inputs, commit};
  if (++unsaved_ >= kSaveEvery) save();
}

void LatentManifest::save() {
  Json assets = Json::object();
  for (const auto& [id, entry] : entries_) assets[id] = {{"inputs", entry.inputs}, {"commit", entry.commit}};
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
