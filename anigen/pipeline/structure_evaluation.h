#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/eval/tables.h"

namespace anigen::pipeline {

/// What `anigen-eval --ss-flow …` is told.
struct StructureEvaluationRequest {
  std::filesystem::path run;          ///< run folder of stage 4
  std::filesystem::path autoencoder;  ///< run folder of stage 2; empty: the one of the flow's config
  std::string data;                   ///< dataset roots, comma-separated
  std::filesystem::path split;        ///< ids to generate from their pictures
  std::filesystem::path train_split;  ///< ids that retrieval chooses from; empty: those of the flow's config
  std::filesystem::path out;          ///< folder for the results
  std::vector<double> strengths;      ///< of guidance; empty: that of the flow's config
  std::int64_t steps = 0;             ///< of the sampler; 0: that of the flow's config
  std::size_t most = 0;               ///< assets; 0: all
  std::size_t pictured = 8;           ///< rows of the contact sheet
  std::size_t retrieval_views = 4;    ///< random views of every training asset; 0: no retrieval
  std::uint64_t seed = 0;
  std::string device = "cpu";
};

/// How near one method's voxels come to those of an asset.
struct StructureScore {
  double iou = 0.0, f1 = 0.0;          ///< of the surface; F1 within one voxel (models/voxel_metrics.h)
  double iou_skl = 0.0, f1_skl = 0.0;  ///< of the skeleton, dilated as stage 2 saw it
  double inside = 0.0;  ///< share of the skeleton's voxels inside its own surface (models/voxel_inside.h)
};

struct StructureEvaluation {
  std::vector<std::string> methods;
  std::vector<std::string> ids, sources;            ///< of the assets
  std::vector<std::vector<StructureScore>> scores;  ///< [method][asset]
  Json settings = Json::object();

  /// Mean of a method over assets, of all or of those whose source begins with `source`.
  StructureScore mean(std::size_t method, const std::string& source = "") const;
  eval::Table table(const std::string& source = "") const;
};

/// Generates voxels from one picture of each asset and compares them with the asset's own, beside
/// - the auto-encoder, which decodes the asset's own latents: the most that any flow over them can reach;
/// - retrieval: the voxels of the training asset whose picture is nearest, once by colour (means over a grid of cells)
///   and once by the tokens of the flow's image encoder (cosine of their concatenation);
/// - the ground truth itself, for `inside`.
/// Writes metrics.csv (per asset), metrics.json, table.md and samples.png into out.
/// @throws InputError when runs, data or splits do not fit together; Interrupted
StructureEvaluation evaluate_structures(const StructureEvaluationRequest& request);

}  // namespace anigen::pipeline
