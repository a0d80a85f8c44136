#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/geometry/vote_clustering.h"
#include "anigen/loaders/datasets/feature_skeleton_options.h"
#include "anigen/loaders/metadata.h"
#include "anigen/models/structured_latent_runs.h"
#include "anigen/models/structured_latent_variant.h"
#include "anigen/pipeline/rig_decoder.h"

namespace anigen::pipeline {

/// A trained structured-latent auto-encoder at work on one asset at a time, which it sees as in its training (features,
/// dilation and surface lookup of its run's config), in whatever variant was trained.
class StructuredLatentCoder {
 public:
  /// @param run folder of stage 3 @param ckpt as models::find_run_model @param decodes also load
  /// the decoder, which groups votes so
  /// @throws InputError when the run is unusable
  StructuredLatentCoder(const std::filesystem::path& run, const std::string& ckpt, torch::Device device,
                        const std::optional<geometry::MeanShiftOptions>& decodes);

  const std::filesystem::path& checkpoint() const { return found_.checkpoint; }
  /// What a latent depends on besides the asset's files.
  std::string fingerprint() const;
  /// Folder of the features below features/.
  const std::string& feature_model() const { return data_.model; }
  std::int64_t geometry_channels() const { return encoder_->options().latent_channels; }

  /// What an asset's latent is made from: features, skeleton voxels, rig.
  std::vector<std::filesystem::path> files(const loaders::AssetId& asset) const;

  struct Inputs {
    sparse::SparseTensor x, x_skl;
    models::RiggedMeshes rigs;
  };
  /// A batch of one. @throws InputError when the asset cannot be read
  Inputs inputs(const loaders::AssetId& asset) const;

  /// Posterior means of the geometry, normalised latents of skin and skeleton: no noise.
  models::PerStream<sparse::SparseTensor> encode(const Inputs& inputs);
  /// Writes coords, feats, coords_skl and feats_skl (reference training-and-data.md, 1.1).
  /// @throws InputError when a latent is not finite; Error when the disk refuses
  void write(const models::PerStream<sparse::SparseTensor>& latents, const std::filesystem::path& file) const;

  /// True where the run trained the shape alone: what it decodes is held by one joint.
  bool shape_alone() const { return variant_.geometry_only; }
  /// Back to an asset: rigged, or the shape of a run that trained nothing else, then without votes.
  /// @pre the decoder was loaded
  /// @param own skeleton of the asset @param use_own instead of the grouped one
  /// @throws as RigDecoder::decode
  RigDecoder::Decoded decode(const models::PerStream<sparse::SparseTensor>& latents, const fields::SkeletonTensors& own,
                             bool use_own, const std::string& name);

 private:
  torch::Device device_;
  models::RunModel found_;
  loaders::FeatureSkeletonOptions data_;
  models::StructuredLatentVariant variant_;
  models::StructuredLatentEncoder encoder_ = nullptr;
  std::optional<RigDecoder> decoder_;                        ///< of a run with rigs
  models::StructuredLatentDecoder shape_decoder_ = nullptr;  ///< of one without
};

}  // namespace anigen::pipeline
