#pragma once
#include <cstddef>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "anigen/loaders/metadata.h"
#include "anigen/pipeline/latent_folder.h"
#include "anigen/pipeline/latent_statistics.h"

namespace anigen::pipeline {

/// What `anigen-encode ss` and `anigen-encode slat` are told.
struct EncodeRequest {
  std::filesystem::path run;   ///< run folder of stage 2 or 3
  std::filesystem::path data;  ///< root of one dataset
  std::string name;            ///< of the latents, as LatentFolder; empty: that of the run folder
  std::string ckpt;            ///< as models::find_run_model
  std::string device = "cpu";
  bool check = false;              ///< ss: also decode every latent and compare with its voxels
  bool again = false;              ///< encode also what is up to date
  bool accept_other_code = false;  ///< keep latents whatever build of the program made them
  /// Called after each asset; whatever it throws ends the run as Ctrl-C does.
  std::function<void(std::size_t done, std::size_t assets)> progress = nullptr;
};

/// What became of the assets of a dataset.
struct EncodedLatents {
  std::string name;
  std::filesystem::path checkpoint;
  std::size_t assets = 0;                     ///< of the dataset that can be encoded
  std::size_t encoded = 0;                    ///< now
  std::size_t up_to_date = 0;                 ///< kept from an earlier run
  std::map<std::string, std::string> failed;  ///< id → what is wrong
  LatentStatistics shape, skeleton;           ///< over all latents there are
};

/// The numbers of a latent by channel, as statistics take them.
struct LatentValues {
  std::vector<float> shape, skeleton;  ///< [C, count]
  std::size_t shape_channels = 0, skeleton_channels = 0;
};

/// One kind of latents: the encoder at work on one asset at a time, and its files.
class LatentSource {
 public:
  virtual ~LatentSource() = default;
  virtual std::filesystem::path checkpoint() const = 0;
  /// Of the encoder: what a latent depends on besides its inputs.
  virtual std::string fingerprint() const = 0;
  /// Column of metadata.csv that says which assets can be encoded.
  virtual std::string required_flag() const = 0;
  virtual std::vector<std::filesystem::path> inputs(const loaders::AssetId& asset) const = 0;
  /// @throws InputError when an input cannot be read or the latent is not finite; Error when the disk refuses
  virtual void encode(const loaders::AssetId& asset, const std::filesystem::path& file) = 0;
  /// @throws InputError when the file is missing or damaged
  virtual LatentValues read(const std::filesystem::path& file) const = 0;
  /// How many channels of the shape latents LatentFolder::write_statistics() normalises.
  virtual std::size_t normalized_channels() const { return 0; }
  /// Anything else to do with a latent that was encoded or kept; it counts only when this returns.
  virtual void inspect(const loaders::AssetId& asset, const std::filesystem::path& file) {
    static_cast<void>(asset);
    static_cast<void>(file);
  }
};

/// Encodes the assets of a dataset, keeping the latents whose encoder, inputs and commit (core/version.h) have not
/// changed; writes their statistics, and the flags into metadata.csv.
/// However a run ends, what metadata.csv flags and the statistics describe are latents of one encoder: before the first
/// latent is replaced the flags become those of what is kept and the statistics are removed; both return at the end.
/// An asset that fails, for whatever reason, is named in the result and not flagged.
/// Several processes called alike share the assets by leases; each returns, with the result of all, when everything is
/// encoded. What LatentSource::inspect() gathers is of the assets that this process had.
/// @throws InputError when dataset or name are unusable, no asset can be encoded, or another program is at work there;
/// Interrupted after saving
EncodedLatents encode_latents(const EncodeRequest& request, const LatentFolder& folder, LatentSource& source);

Json to_json(const EncodedLatents& result);
/// One line for a terminal. @param kind folder of the latents below the dataset
std::string to_text(const EncodedLatents& result, const std::string& kind);

}  // namespace anigen::pipeline
