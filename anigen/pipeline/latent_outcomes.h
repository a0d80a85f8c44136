#pragma once
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>

#include "anigen/core/json.h"
#include "anigen/pipeline/latent_statistics.h"

namespace anigen::pipeline {

/// What became of one asset that was to be encoded.
struct LatentOutcome {
  std::string inputs;   ///< fingerprint of what was encoded; empty: the latent was kept from an earlier run
  std::string failure;  ///< empty: there is a latent
  LatentMoments shape, skeleton;
  std::string commit{};  ///< of the program that encoded it (core/version.h); empty when it was kept
};

/// What the processes that encode one dataset by one encoder tell each other, run/encode-<column>/: run.json, which
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

  /// Whether flags, statistics and list are those of this run.
  bool concluded() const;
  void set_concluded() const;

 private:
  std::filesystem::path file(const std::string& id) const { return folder_ / "assets" / (id + ".json"); }
  std::filesystem::path run_file() const { return folder_ / "run.json"; }

  std::filesystem::path folder_;
};

}  // namespace anigen::pipeline
