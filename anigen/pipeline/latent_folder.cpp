#include "anigen/pipeline/latent_folder.h"

#include <algorithm>
#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/io/npz.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;

constexpr char kShape[] = "feats", kSkeleton[] = "feats_skl";

/// "runs/ss_dae/" is called ss_dae, and a link as it is called itself.
std::string last_part(const fs::path& run) {
  std::error_code error;
  const fs::path whole = fs::absolute(run, error).lexically_normal();
  return (whole.has_filename() ? whole : whole.parent_path()).filename().string();
}

void warn_of_constant_channels(const LatentStatistics& statistics, const char* name) {
  std::string channels;
  for (const std::size_t channel : statistics.constant_channels()) {
    channels += (channels.empty() ? "" : ", ") + std::to_string(channel);
  }
  if (channels.empty()) return;
  log::warn("{}: channels {} have the same value in all latents: such statistics cannot normalise them", name,
            channels);
}

}  // namespace

LatentFolder::LatentFolder(const fs::path& data, const std::string& name, const fs::path& run)
    : name_(name.empty() ? last_part(run) : name), path_(data / "ss_latents" / name_) {
  const bool plain = !name_.empty() && name_.front() != '.' && std::all_of(name_.begin(), name_.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-' ||
           c == '.';
  });
  if (!plain) {
    throw InputError("", "--name", "'" + name_ + "': a name of latents has letters, digits, '_', '-' and '.' only");
  }
}

fs::path LatentFolder::statistics(const char* extension) const {
  return path_.parent_path() / (name_ + "_statistics" + extension);
}

void LatentFolder::write_statistics(const LatentStatistics& shape, const LatentStatistics& skeleton) const {
  warn_of_constant_channels(shape, kShape);
  warn_of_constant_channels(skeleton, kSkeleton);
  io::NamedArrays arrays;
  append_arrays(arrays, kShape, shape);
  append_arrays(arrays, kSkeleton, skeleton);
  io::write_npz(statistics(".npz"), arrays);
  const Json json = {{"assets", shape.assets()}, {kShape, to_json(shape)}, {kSkeleton, to_json(skeleton)}};
  write_file_atomically(statistics(".json"), json.dump(2) + "\n");
}

void LatentFolder::remove_statistics() const {
  for (const char* extension : {".npz", ".json"}) {
    std::error_code error;
    fs::remove(statistics(extension), error);
    if (error) throw Error(statistics(extension).string() + ": cannot be removed: " + error.message());
  }
}

}  // namespace anigen::pipeline
