#pragma once
#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/io/arrays/ndarray.h"

namespace anigen::generate {

/// Manifest of the inputs of a folder's latents, kept in the folder as encoded.json: a fingerprint of the encoder and,
/// for every asset, one of the files that were encoded and the commit (core/version.h) of the program that encoded
/// them. An entry is added after its latent was written and erased before it is replaced, so what the file promises is
/// there however a run ends; latents that a killed run did not enter are made again.
class LatentManifest {
 public:
  /// Reads the folder's manifest; one of another encoder, or a damaged one, counts as empty.
  LatentManifest(const std::filesystem::path& folder, std::string encoder);
  /// Saves what was added; a disk that refuses is a warning here.
  ~LatentManifest();
  LatentManifest(const LatentManifest&) = delete;
  LatentManifest& operator=(const LatentManifest&) = delete;

  bool has(const std::string& id) const { return entries_.count(id) > 0; }
  bool up_to_date(const std::string& id, const std::string& inputs) const;
  /// Of the program that encoded an asset; "" where the file does not say.
  std::string commit_of(const std::string& id) const;
  /// To be called before latents are replaced: erases their entries, and all of another encoder, from the file.
  /// @throws Error when the disk refuses
  void forget(const std::vector<std::string>& ids);
  /// Saves now and then. @throws Error when the disk refuses
  void add(const std::string& id, const std::string& inputs, const std::string& commit);
  void save();

 private:
  struct Entry {
    std::string inputs, commit;
  };
  std::filesystem::path file_;
  std::string encoder_;
  std::map<std::string, Entry> entries_;
  std::size_t unsaved_ = 0;
};

/// Fingerprint of some files together. @throws InputError when one cannot be read
std::string fingerprint_of_files(const std::vector<std::filesystem::path>& files);

/// The mean and the mean square of one latent per channel.
struct LatentMoments {
  std::vector<double> mean, mean_square;
};
ANIGEN_JSON_RECORD(LatentMoments, mean, mean_square)

/// @param values [C, count] or more dimensions behind C @throws InputError without any, or unless C divides them
LatentMoments moments_of(const std::vector<float>& values, std::size_t channels, const std::string& name);

/// Mean and deviation of latents per channel: each asset's mean and mean square, averaged over assets, so that large
/// assets do not count more; deviation √(E[x²] − E[x]²) (docs/reference/training.md, 1.2).
class LatentStatistics {
 public:
  /// @throws InputError when the number of channels differs from earlier assets'
  void add(const LatentMoments& moments, const std::string& name);

  std::size_t assets() const { return assets_; }
  std::vector<float> mean() const;
  std::vector<float> deviation() const;
  /// Channels with the same value everywhere, up to rounding: nothing can be divided by their deviation.
  std::vector<std::size_t> constant_channels() const;

 private:
  std::vector<double> sum_, sum_of_squares_;
  std::size_t assets_ = 0;
};

Json to_json(const LatentStatistics& statistics);

enum class LatentKind {
  kStructure,  ///< of stage 2: ss_latents/, columns ss_latent_<name>
  kStructured  ///< of stage 3: latents/, columns latent_<name>
};

/// Folder in which a dataset keeps the latents of one encoder: <kind>/<name>/<id>.npz, beside the folder
/// <name>_statistics.npz and .json, and in metadata.csv a column of flags.
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

  /// Warns of channels that do not vary. The JSON of structured latents also holds `normalization` as the dataset of
  /// stage 5 takes it. @param normalized how many channels of `shape` it normalises; the others, and the skeleton's,
  /// lie on spheres and keep mean 0 and deviation 1, as published (docs/reference/training.md, 1.2)
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

/// Outcome of encoding one asset.
struct LatentOutcome {
  std::string inputs;   ///< fingerprint of what was encoded; empty: the latent was kept from an earlier run
  std::string failure;  ///< empty: there is a latent
  LatentMoments shape, skeleton;
  std::string commit{};  ///< of the program that encoded it (core/version.h); empty when it was kept
};
ANIGEN_JSON_RECORD(LatentOutcome, inputs, failure, shape, skeleton, commit)

/// Messages between the processes that encode one dataset by one encoder, run/encode-<column>/: run.json, which
/// encoder it is and whose latents of earlier runs are kept, and a file per asset, so that nobody writes to another's.
class LatentOutcomes {
 public:
  LatentOutcomes(const std::filesystem::path& data, const std::string& column);

  /// Files of leases.
  std::filesystem::path leases() const { return folder_ / "leases"; }

  /// Assets that the previous run encoded here, by id. Empty when its encoder was another one.
  std::map<std::string, LatentOutcome> encoded_by(const Json& encoder) const;
  /// Forgets that run and begins another one.
  void begin(const Json& encoder, const std::set<std::string>& kept) const;
  /// Of the run that is going on. @return false when it is of another encoder, or of another commit of the program
  bool join(const Json& encoder, std::set<std::string>& kept) const;

  std::optional<LatentOutcome> read(const std::string& id) const;  ///< nothing: not done yet
  void write(const std::string& id, const LatentOutcome& outcome) const;

  /// True when flags, statistics and list are those of this run.
  bool concluded() const;
  void set_concluded() const;

 private:
  std::filesystem::path file(const std::string& id) const { return folder_ / "assets" / (id + ".json"); }
  std::filesystem::path run_file() const { return folder_ / "run.json"; }

  std::filesystem::path folder_;
};

}  // namespace anigen::generate
