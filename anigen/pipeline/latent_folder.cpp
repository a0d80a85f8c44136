#include "anigen/pipeline/latent_folder.h"

#include <algorithm>
#include <cstddef>
#include <system_error>
#include <vector>

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

/// Arguments of the dataset of stage 5; a channel that does not vary keeps deviation 1.
Json normalization(const LatentStatistics& shape, const LatentStatistics& skeleton, std::size_t normalized) {
  std::vector<float> mean = shape.mean(), deviation = shape.deviation();
  std::fill(mean.begin() + static_cast<std::ptrdiff_t>(std::min(normalized, mean.size())), mean.end(), 0.0f);
  std::fill(deviation.begin() + static_cast<std::ptrdiff_t>(std::min(normalized, deviation.size())), deviation.end(),
            1.0f);
  for (const std::size_t channel : shape.constant_channels()) deviation[channel] = 1.0f;
  const std::size_t channels = skeleton.mean().size();
  return {{"mean", mean},
          {"std", deviation},
          {"mean_skl", std::vector<float>(channels, 0.0f)},
          {"std_skl", std::vector<float>(channels, 1.0f)}};
}

}  // namespace

LatentFolder::LatentFolder(const fs::path& data, const std::string& name, const fs::path& run, LatentKind kind)
    : kind_(kind),
      name_(name.empty() ? last_part(run) : name),
      path_(data / (kind == LatentKind::kStructure ? "ss_latents" : "latents") / name_) {
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

void LatentFolder::write_statistics(const LatentStatistics& shape, const LatentStatistics& skeleton,
                                    std::size_t normalized) const {
  warn_of_constant_channels(shape, kShape);
  warn_of_constant_channels(skeleton, kSkeleton);
  io::NamedArrays arrays;
  append_arrays(arrays, kShape, shape);
  append_arrays(arrays, kSkeleton, skeleton);
  io::write_npz(statistics(".npz"), arrays);
  Json json = {{"assets", shape.assets()}, {kShape, to_json(shape)}, {kSkeleton, to_json(skeleton)}};
  if (kind_ == LatentKind::kStructured) json["normalization"] = normalization(shape, skeleton, normalized);
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
