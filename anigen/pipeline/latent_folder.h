#pragma once
#include <filesystem>
#include <string>

#include "anigen/pipeline/latent_statistics.h"

namespace anigen::pipeline {

/// Where a dataset keeps the structure latents of one encoder: ss_latents/<name>/<id>.npz, beside the folder
/// <name>_statistics.npz and .json, and in metadata.csv the column ss_latent_<name>.
class LatentFolder {
 public:
  /// @param name letters, digits, '_', '-', '.'; empty: the last part of the run's path, as it was given
  /// @throws InputError when the name has other characters, or begins with '.'
  LatentFolder(const std::filesystem::path& data, const std::string& name, const std::filesystem::path& run);

  const std::string& name() const { return name_; }
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path file(const std::string& id) const { return path_ / (id + ".npz"); }
  std::string column() const { return "ss_latent_" + name_; }

  /// Warns of channels that do not vary. @throws Error when the disk refuses
  void write_statistics(const LatentStatistics& shape, const LatentStatistics& skeleton) const;
  /// @throws Error when the disk refuses
  void remove_statistics() const;

 private:
  std::filesystem::path statistics(const char* extension) const;

  std::string name_;
  std::filesystem::path path_;
};

}  // namespace anigen::pipeline
