#pragma once
#include <cstddef>
#include <filesystem>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "anigen/core/process.h"
#include "anigen/data/metadata.h"
#include "anigen/generate/grouping.h"
#include "anigen/generate/latent_records.h"
#include "anigen/skeleton_field/voting.h"

namespace anigen::generate {

/// Sets a boolean column of a dataset's metadata.csv: True for these ids, False for all others; everything else in the
/// table stays as it is. A column that is not there is added. Written atomically, and only if something changes. Safe
/// beside other programs that change the table: they lock the same files, run/lock and run/lock-metadata.
/// @param root folder of metadata.csv @throws InputError when the table cannot be read or has no ids, or as
/// share_dataset(); Interrupted while another program keeps the table locked
void set_metadata_flag(const std::filesystem::path& root, const std::string& column, const std::set<std::string>& ids);

/// Request of `anigen-encode reconstruct`.
struct ReconstructRequest {
  std::filesystem::path run;   ///< run folder of stage 3
  std::filesystem::path data;  ///< root of one dataset
  std::vector<std::string> ids;
  std::vector<std::filesystem::path> splits;  ///< files of more ids
  std::filesystem::path output;               ///< folder of the files <id>.glb
  std::string ckpt;                           ///< as nn::find_run_model
  std::string device = "cpu";
  bool true_skeleton = false;  ///< decode weights for the asset's own skeleton instead of the grouped one
  skeleton_field::MeanShiftOptions grouping;  ///< of the votes for joints
  bool votes = false;                         ///< also <id>.votes.glb and <id>.votes.ply, as write_votes()
};

/// Request of `anigen-encode ss` and `anigen-encode slat`.
struct EncodeRequest {
  std::filesystem::path run;   ///< run folder of stage 2 or 3
  std::filesystem::path data;  ///< root of one dataset
  std::string name;            ///< of the latents, as LatentFolder; empty: that of the run folder
  std::string ckpt;            ///< as nn::find_run_model
  std::string device = "cpu";
  bool check = false;              ///< ss: also decode every latent and compare with its voxels
  bool again = false;              ///< encode also what is up to date
  bool accept_other_code = false;  ///< keep latents whatever build of the program made them
  std::filesystem::path ss_flow;   ///< slat: run of stage 4, at whose voxels of `view` or the mesh; empty: at the own
  std::filesystem::path ss_dae;    ///< run of stage 2 that decodes them; empty: the one the flow names
  std::size_t view = 0;            ///< condition view of each asset, counted round
  /// Called after each asset; whatever it throws ends the run as Ctrl-C does.
  std::function<void(std::size_t done, std::size_t assets)> progress = nullptr;
};

/// Outcome of encoding the assets of a dataset.
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
  virtual std::vector<std::filesystem::path> inputs(const data::AssetId& asset) const = 0;
  /// @throws InputError when an input cannot be read or the latent is not finite; Error when the disk refuses
  virtual void encode(const data::AssetId& asset, const std::filesystem::path& file) = 0;
  /// @throws InputError when the file is missing or damaged
  virtual LatentValues read(const std::filesystem::path& file) const = 0;
  /// Number of channels of the shape latents that LatentFolder::write_statistics() normalises.
  virtual std::size_t normalized_channels() const { return 0; }
  /// Anything else to do with a latent that was encoded or kept; it counts only when this returns.
  virtual void inspect(const data::AssetId& asset, const std::filesystem::path& file) {
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
/// @throws InputError when dataset or name are unusable, no asset can be encoded, or another program is there;
/// Interrupted after saving
EncodedLatents encode_latents(const EncodeRequest& request, const LatentFolder& folder, LatentSource& source);

Json to_json(const EncodedLatents& result);
/// One line for a terminal. @param kind folder of the latents below the dataset
std::string to_text(const EncodedLatents& result, const std::string& kind);

}  // namespace anigen::generate

namespace anigen {

/// The command line of anigen-encode.
struct EncodeArguments {
  enum class Task { kStructure, kStructuredLatents, kReconstruct, kGrouping };
  Task task = Task::kStructure;
  generate::EncodeRequest encoded;       ///< of the first two
  generate::ReconstructRequest rebuilt;  ///< of the third
  generate::GroupingRequest grouped;     ///< of the fourth
};

}  // namespace anigen
