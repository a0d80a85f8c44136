#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/table.h"
#include "anigen/generate/stage_generators.h"
#include "anigen/io/image.h"
#include "anigen/nn/state_dict.h"
#include "anigen/skin_field/skin_autoencoder.h"

namespace anigen::generate {

/// Request of `anigen-eval --ss-flow …`.
struct StructureEvaluationRequest {
  std::filesystem::path run;                  ///< run folder of stage 4
  std::filesystem::path autoencoder;          ///< run folder of stage 2; empty: the one of the flow's config
  std::string data;                           ///< dataset roots, comma-separated
  std::vector<std::filesystem::path> splits;  ///< files of the ids to generate from their pictures, at least one
  std::filesystem::path train_split;          ///< ids that retrieval chooses from; empty: those of the flow's config
  std::filesystem::path out;                  ///< folder for the results
  std::vector<double> strengths;              ///< of guidance; empty: that of the flow's config
  std::int64_t steps = 0;                     ///< of the sampler; 0: that of the flow's config
  std::size_t most = 0;                       ///< assets; 0: all
  std::size_t pictured = 8;                   ///< rows of the contact sheet
  std::size_t retrieval_views = 4;            ///< random views of every training asset; 0: no retrieval
  std::uint64_t seed = 0;
  std::string device = "cpu";
};

/// Distance of one method's voxels to those of an asset.
struct StructureScore {
  double iou = 0.0, f1 = 0.0;          ///< of the surface; F1 within one voxel (sparse_structure/voxel_metrics.h)
  double iou_skl = 0.0, f1_skl = 0.0;  ///< of the skeleton, dilated as stage 2 saw it
  double inside = 0.0;  ///< share of the skeleton's voxels inside its own surface (sparse_structure/voxel_metrics.h)
};
ANIGEN_JSON_RECORD(StructureScore, iou, f1, iou_skl, f1_skl, inside)

StructureScore structure_score(const sparse_structure::VoxelPair& made, const sparse_structure::VoxelPair& truth);

struct StructureEvaluation {
  std::vector<std::string> methods;
  std::vector<std::string> ids, sources;            ///< of the assets
  std::vector<std::vector<StructureScore>> scores;  ///< [method][asset]
  Json settings = Json::object();

  StructureScore mean(std::size_t method) const;  ///< over the assets
  Table table() const;
};

/// Generates voxels from one picture of each asset and compares them with the asset's own, beside
/// - the auto-encoder, which decodes the asset's own latents: the most that any flow over them can reach;
/// - retrieval: the voxels of the training asset whose picture is nearest, once by colour (means over a grid of cells)
///   and once by the tokens of the flow's image encoder (cosine of their concatenation);
/// - the ground truth itself, for `inside`.
/// Writes metrics.csv (per asset), metrics.json, table.md and, of what is pictured, samples.png into out.
/// @throws InputError when runs, data or splits do not fit together; Interrupted
StructureEvaluation evaluate_structures(const StructureEvaluationRequest& request);

/// A trained skin auto-encoder used as it is judged: skin weights are encoded into a few numbers per vertex and
/// decoded again (paper 3.3.1; docs/reference/autoencoders.md, 2).
class SkinReconstruction {
 public:
  /// @param run a run folder of stage one (config.json and ckpts/), or a weight file with config.json beside it or in
  ///   the folder above its own. Of a folder, the averaged (EMA) weights of the highest step are taken, and the plain
  ///   ones only when there are no averaged ones.
  /// @param device "cpu", "cuda" or "cuda:N"
  /// @throws InputError when files are missing, describe no SkinAutoEncoder, or do not fit each other
  explicit SkinReconstruction(const std::filesystem::path& run, const std::string& device = "cpu");

  /// @param joints [J] normalised frame @param parents [J], -1 for roots
  /// @param skin [V, J] row-major, rows sum to 1
  /// @return [V, J] row-major, rows sum to 1. Vertices pass in chunks, so memory does not grow with V.
  std::vector<float> reconstruct(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents,
                                 const std::vector<float>& skin);

  const std::filesystem::path& checkpoint() const { return checkpoint_; }
  std::size_t parameters() const;
  std::int64_t features_per_vertex() const { return model_->options().encoder_config.skin_feat_channels; }

 private:
  std::filesystem::path checkpoint_;
  torch::Device device_;
  skin_field::SkinAutoEncoder model_ = nullptr;
};

}  // namespace anigen::generate
