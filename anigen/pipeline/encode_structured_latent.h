#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/geometry/vote_clustering.h"
#include "anigen/pipeline/latent_encoding.h"

namespace anigen::pipeline {

/// Writes the latents that stage 5 learns from (reference training-and-data.md, 1.1 and 1.3), of all assets with the
/// features its encoder reads: `latents/<name>/<id>.npz` with `coords` [N, 3] uint8, `feats` [N, 16] (geometry 8, skin
/// 8), `coords_skl` [M, 3] uint8 and `feats_skl` [M, 4] fp32; the geometry's posterior mean, skin and skeleton as they
/// are normalised, without noise. Beside the folder the statistics, whose JSON holds `normalization` for the dataset of
/// stage 5; in metadata.csv the column `latent_<name>`.
/// @throws InputError when the run is unusable, and as encode_latents(), which says what is kept and what is replaced
EncodedLatents encode_structured_latents(const EncodeRequest& request);

/// What `anigen-encode reconstruct` is told.
struct ReconstructRequest {
  std::filesystem::path run;   ///< run folder of stage 3
  std::filesystem::path data;  ///< root of one dataset
  std::vector<std::string> ids;
  std::filesystem::path split;   ///< file of more ids; may be empty
  std::filesystem::path output;  ///< folder of the files <id>.glb
  std::string ckpt;              ///< as models::find_run_model
  std::string device = "cpu";
  bool true_skeleton = false;           ///< decode weights for the asset's own skeleton instead of the grouped one
  geometry::MeanShiftOptions grouping;  ///< of the votes for joints
  bool votes = false;                   ///< also <id>.votes.glb and <id>.votes.ply, as write_votes()
};

/// One asset that went through the auto-encoder.
struct ReconstructedAsset {
  std::string id;
  std::filesystem::path file;
  std::size_t joints = 0, true_joints = 0, vertices = 0, faces = 0;
  std::string failure;  ///< why there is no file; empty when there is one
};

/// Encodes assets of a dataset and writes what their latents decode to as rigged GLB files; with one joint where the
/// run trained the shape alone (`geometry_only`). An asset that fails, for whatever reason, is named in the result and
/// the rest goes on. @throws InputError when the run is unusable, an id is none, or a result would replace a file of the
/// dataset, before any work; WriteError when the disk refuses; Interrupted between assets
std::vector<ReconstructedAsset> reconstruct_assets(const ReconstructRequest& request);

Json to_json(const std::vector<ReconstructedAsset>& assets);
/// A line per asset.
std::string to_text(const std::vector<ReconstructedAsset>& assets);

}  // namespace anigen::pipeline
