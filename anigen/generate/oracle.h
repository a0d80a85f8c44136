#pragma once
#include <array>
#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/eval/comparison.h"
#include "anigen/eval/evaluate_command.h"
#include "anigen/generate/evaluate.h"
#include "anigen/generate/generate_assets.h"

namespace anigen::generate {

/// Request of `anigen-eval --oracle`.
struct OracleRequest {
  GenerateRequest generation;     ///< models, samplers, conditions and finishing of assets; `output` for everything
  eval::EvaluationRequest pairs;  ///< `truth`, the dataset; at least one of `splits`; `most`; settings of the metrics
};

/// Ways to make an asset, by what of it is true.
inline constexpr std::array<const char*, 4> kOracleRows = {
    "autoencoder",   ///< stage 3: true voxels with true latents
    "true_voxels",   ///< stage 5 on true voxels
    "true_latents",  ///< stage 3 on the voxels of stage 4: what stage 5 would give there if it were perfect
    "generation"     ///< stage 5 on the voxels of stage 4
};

/// Outcome of one asset.
struct OracleAsset {
  std::string id;
  std::map<std::string, std::string> failures;      ///< row → why it has no mesh
  std::map<std::string, StructureScore> structure;  ///< "stage 2" and "stage 4": voxels decoded from the asset's own
                                                    ///< latent, and from a sampled one; what failed is left out
};
ANIGEN_JSON_RECORD(OracleAsset, id, failures, structure)

struct Oracle {
  std::vector<OracleAsset> assets;
  std::optional<eval::Comparison> aligned, unaligned;  ///< with registration and without; nothing without meshes
  Json settings = Json::object();
};

/// Makes every asset of the splits in the four ways of kOracleRows, groups and finishes each as generate_assets() does,
/// and evaluates all against the dataset: the difference of two rows is what one stage adds to the error. Conditions
/// are first condition views. Writes into the output folder <row>/<id>/mesh.glb, assets/<id>.json, aligned/ and
/// unaligned/ (run_evaluation()), oracle.md and oracle.json. Finished assets are kept; a way that fails is named and
/// the rest goes on. Several processes called alike share the assets by leases.
/// @throws InputError when models, dataset or splits are unusable; NotSupportedError when the auto-encoder sees other
/// features than `surface` or a mesh is missing, before any work; WriteError; Interrupted
Oracle evaluate_oracle(const OracleRequest& request);

/// Assets of which at least one row has no mesh.
std::size_t failures(const Oracle& oracle);

Json to_json(const Oracle& oracle);
/// oracle.md: rows by metrics with registration, without it, the voxels of stages 2 and 4, and failures.
std::string to_markdown(const Oracle& oracle);

}  // namespace anigen::generate
