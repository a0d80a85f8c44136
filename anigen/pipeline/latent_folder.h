#pragma once
#include <cstddef>
#include <filesystem>
#include <string>

#include "anigen/pipeline/latent_statistics.h"

namespace anigen::pipeline {

enum class LatentKind {
  kStructure,  ///< of stage 2: ss_latents/, columns ss_latent_<name>
  kStructured  ///< of stage 3: latents/, columns latent_<name>
};

/// Where a dataset keeps the latents of one encoder: <kind>/<name>/<id>.npz, beside the folder <name>_statistics.npz
/// and .json, and in metadata.csv a column of flags.
class LatentFolder {
 public:
  /// @param name letters, digits, '_', '-', '.'; empty: the last part of the run's path, as it was given
  /// @throws InputError when the name has other characters, or begins with '.'
  LatentFolder(const std::filesystem::path& data, const std::string& name, const std::filesystem::path& run,
               LatentKind kind = LatentKind::kStructure);

  const std::string& name() const { return name_; }
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path file(const std::string& id) const { return path_ / (id + ".npz"); }
  std::string column() const { return (kind_ == LatentKind::kStructure ? "ss_latent_" : "latent_") + name_; }
  /// Of the folder that holds the latents' folder.
  std::string kind_name() const { return path_.parent_path().filename().string(); }

  /// Warns of channels that do not vary. The JSON of structured latents also holds `normalization` as the dataset of
  /// stage 5 takes it. @param normalized how many channels of `shape` it normalises; the others, and the skeleton's,
  /// lie on spheres and keep mean 0 and deviation 1, as published (reference training-and-data.md, 1.3)
  /// @throws Error when the disk refuses
  void write_statistics(const LatentStatistics& shape, const LatentStatistics& skeleton,
                        std::size_t normalized = 0) const;
  /// @throws Error when the disk refuses
  void remove_statistics() const;

 private:
  std::filesystem::path statistics(const char* extension) const;

  LatentKind kind_;
  std::string name_;
  std::filesystem::path path_;
};

}  // namespace anigen::pipeline
