#pragma once
#include <optional>
#include <string>

#include "anigen/core/json.h"
#include "anigen/pipeline/latent_encoding.h"
#include "anigen/pipeline/structure_coder.h"

namespace anigen::pipeline {

struct EncodeResult : EncodedLatents {
  std::optional<StructureReconstruction> reconstruction;  ///< means over assets
};

/// Writes the latents that stage 4 learns from (reference training-and-data.md, 1.1 and 1.3), of all assets with
/// `voxelized`: `ss_latents/<name>/<id>.npz` with `mean` [8, 16³] and `mean_skl` [4, 16³] fp32, the encoder's posterior
/// mean and its normalised skeleton latent, from voxels as stage 2 saw them (its config's resolution and dilation),
/// without noise. Beside the folder `<name>_statistics.npz` (feats_mean, feats_std, feats_skl_mean, feats_skl_std, for
/// the dataset's `normalization` arguments) and the same as JSON; in metadata.csv the column `ss_latent_<name>`.
/// @throws InputError when the run is unusable, and as encode_latents(), which says what is kept and what is replaced
EncodeResult encode_sparse_structure(const EncodeRequest& request);

Json to_json(const EncodeResult& result);
/// A few lines for a terminal.
std::string to_text(const EncodeResult& result);

}  // namespace anigen::pipeline
