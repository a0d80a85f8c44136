#pragma once
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/generate/encode.h"
#include "anigen/generate/stage_generators.h"

namespace anigen::generate {

struct EncodeResult : EncodedLatents {
  std::optional<StructureReconstruction> reconstruction;  ///< means over assets
};

/// Writes the latents that stage 4 learns from (docs/reference/training.md, 1.1 and 1.2), of all assets with
/// `voxelized`: `ss_latents/<name>/<id>.npz` with `mean` [8, 16³] and `mean_skl` [4, 16³] fp32, the encoder's posterior
/// mean and its normalised skeleton latent, from voxels as stage 2 saw them (its config's resolution and dilation),
/// without noise. Beside the folder `<name>_statistics.npz` (feats_mean, feats_std, feats_skl_mean, feats_skl_std, for
/// the dataset's `normalization` arguments) and the same as JSON; in metadata.csv the column `ss_latent_<name>`.
/// @throws InputError when the run is unusable, and as encode_latents(), which says what is kept and what is replaced
EncodeResult encode_sparse_structure(const EncodeRequest& request);

Json to_json(const EncodeResult& result);
/// A few lines for a terminal.
std::string to_text(const EncodeResult& result);

/// Writes the latents that stage 5 learns from (docs/reference/training.md, 1.1 and 1.2), of all assets with the
/// features its encoder reads: `latents/<name>/<id>.npz` with `coords` [N, 3] uint8, `feats` [N, 16] (geometry 8, skin
/// 8), `coords_skl` [M, 3] uint8 and `feats_skl` [M, 4] fp32; the geometry's posterior mean, skin and skeleton as they
/// are normalised, without noise. With `ss_flow`, at the voxels that it sees in a view, which the file names; with one
/// without images, at the asset's own voxels and those of the skeleton that it finds in them. Beside the folder the
/// statistics, whose JSON holds `normalization` for the dataset of stage 5; in metadata.csv the column `latent_<name>`.
/// @throws InputError when the run is unusable, and as encode_latents(), which says what is kept and what is replaced
EncodedLatents encode_structured_latents(const EncodeRequest& request);

/// One asset that went through the auto-encoder.
struct ReconstructedAsset {
  std::string id;
  std::filesystem::path file;
  std::size_t joints = 0, true_joints = 0, vertices = 0, faces = 0;
  std::string failure;  ///< why there is no file; empty when there is one
};

/// Encodes assets of a dataset and writes what their latents decode to as rigged GLB files; with one joint where the
/// run trained the shape alone (`geometry_only`). An asset that fails, for whatever reason, is named in the result and
/// the rest goes on. @throws InputError when the run is unusable, an id is none, or a result would replace a file of
/// the dataset, before any work; WriteError when the disk refuses; Interrupted between assets
std::vector<ReconstructedAsset> reconstruct_assets(const ReconstructRequest& request);

Json to_json(const std::vector<ReconstructedAsset>& assets);
/// A line per asset.
std::string to_text(const std::vector<ReconstructedAsset>& assets);

}  // namespace anigen::generate
