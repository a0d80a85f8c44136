#pragma once
#include <cstddef>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "anigen/core/json.h"
#include "anigen/pipeline/latent_statistics.h"
#include "anigen/pipeline/structure_coder.h"

namespace anigen::pipeline {

/// What `anigen-encode ss` is told.
struct EncodeRequest {
  std::filesystem::path run;   ///< run folder of stage 2
  std::filesystem::path data;  ///< root of one dataset
  std::string name;            ///< of the latents, as LatentFolder; empty: that of the run folder
  std::string ckpt;            ///< as models::find_run_model
  std::string device = "cpu";
  bool check = false;  ///< also decode every latent and compare with its voxels
  bool again = false;  ///< encode also what is up to date
  /// Called after each asset; whatever it throws ends the run as Ctrl-C does.
  std::function<void(std::size_t done, std::size_t assets)> progress = nullptr;
};

struct EncodeResult {
  std::string name;
  std::filesystem::path checkpoint;
  std::size_t assets = 0;                                 ///< of the dataset with `voxelized`
  std::size_t encoded = 0;                                ///< now
  std::size_t up_to_date = 0;                             ///< kept from an earlier run
  std::map<std::string, std::string> failed;              ///< id → what is wrong
  LatentStatistics shape, skeleton;                       ///< over all latents there are
  std::optional<StructureReconstruction> reconstruction;  ///< means over assets
};

/// Writes the latents that stage 4 learns from (reference training-and-data.md, 1.1 and 1.3):
/// `ss_latents/<name>/<id>.npz` with `mean` [8, 16³] and `mean_skl` [4, 16³] fp32, the encoder's posterior mean and its
/// normalised skeleton latent, from voxels as stage 2 saw them (its config's resolution and dilation), without noise.
/// Latents whose encoder and voxel files have not changed are kept. Beside the folder `<name>_statistics.npz`
/// (feats_mean, feats_std, feats_skl_mean, feats_skl_std, for the dataset's `normalization` arguments) and the same as
/// JSON; in metadata.csv the column `ss_latent_<name>`.
/// However a run ends, what metadata.csv flags and the statistics describe are latents of one encoder: before the first
/// latent is replaced the flags become those of what is kept and the statistics are removed; both return at the end.
/// An asset that fails (cannot be read, a latent that is not finite) is named in the result and not flagged.
/// @throws InputError when the run, the dataset or the name is unusable, `voxelized` holds for no asset, or
/// anigen-prepare is at work there; Interrupted after saving
EncodeResult encode_sparse_structure(const EncodeRequest& request);

Json to_json(const EncodeResult& result);
/// A few lines for a terminal.
std::string to_text(const EncodeResult& result);

}  // namespace anigen::pipeline
