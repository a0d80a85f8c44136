#pragma once
#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace anigen::pipeline {

/// What latents of a folder were made from, kept in the folder as encoded.json: a fingerprint of the encoder and, for
/// every asset, one of the files that were encoded and the commit (core/version.h) of the program that encoded them. An
/// entry is added after its latent was written and erased before it is replaced, so what the file promises is there
/// however a run ends; latents that a killed run did not enter are made again.
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

}  // namespace anigen::pipeline
