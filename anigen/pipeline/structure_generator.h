#pragma once
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "anigen/features/condition_encoder.h"
#include "anigen/loaders/datasets/structure_latent_dataset.h"
#include "anigen/models/sparse_structure_runs.h"
#include "anigen/models/sparse_structure_sampling.h"
#include "anigen/models/voxel_picture.h"

namespace anigen::pipeline {

/// A trained sparse-structure flow with its image encoder and the decoder of its latents: pictures become voxels of a
/// shape and its skeleton (paper 3.4; reference flows-and-pipeline.md, 4).
class StructureGenerator {
 public:
  struct Request {
    std::filesystem::path run;          ///< run folder of stage 4
    std::filesystem::path autoencoder;  ///< run folder of stage 2; empty: the one its dataset's ss_dec_path names
    std::string ckpt;                   ///< of the flow, as models::find_flow_model
    std::string device = "cpu";
    models::Averages averages = models::Averages::kUsual;
    torch::Dtype precision = torch::kFloat32;  ///< of the flow's torso
  };
  /// @throws InputError when a run is unusable, or the flow was trained without pictures
  explicit StructureGenerator(const Request& request);

  const models::RunModel& flow() const { return flow_; }
  const std::filesystem::path& autoencoder() const { return autoencoder_; }
  /// Of its dataset: the size and kind of its pictures, and what normalises its latents.
  const loaders::StructureLatentOptions& reading() const { return reading_; }
  const flow::SamplerOptions& sampler() const { return sampler_; }  ///< as its config samples

  /// @param pictures [B, 3, S, S] in [0, 1], S = reading().image_size @return [B, M, C]
  /// @throws InputError at the first call, when the image encoder or its weights are missing or do not fit
  torch::Tensor condition(const torch::Tensor& pictures);
  /// Standard normal numbers of a latent, from the seed and the number of an asset, whatever else is sampled with it.
  flow::Streams noise(std::uint64_t seed, std::uint64_t number) const;
  /// The same as the generator gives them, shape first (reference flows-and-pipeline.md, 5.5).
  flow::Streams noise(const at::Generator& generator) const;
  /// Latents, as the dataset normalises them. @param noise of a batch
  flow::Streams sample(const flow::Streams& noise, const torch::Tensor& condition, const flow::SamplerOptions& sampler,
                       bool guided, const flow::SamplingExtras& extras = {});
  /// What sample() returns as latent files hold it: what normalised it in training is undone.
  flow::Streams denormalised(const flow::Streams& latents) const;
  /// Both grids of one item before anything is decided, [1, 1, R, R, R]. @param latents as decode()
  models::SparseStructureDecoderImpl::Logits logits(const flow::Streams& latents, std::int64_t item);
  /// Occupied voxels of every item, logit > 0, of the skeleton only the largest component (reference
  /// flows-and-pipeline.md, 5.5). @param latents as sample() returns them, or as the dataset holds them
  std::vector<models::VoxelPair> decode(const flow::Streams& latents);

 private:
  torch::Device device_;
  std::filesystem::path run_;
  models::RunModel flow_;
  std::filesystem::path autoencoder_;
  loaders::StructureLatentOptions reading_;
  flow::SamplerOptions sampler_;
  models::SparseStructureFlow model_ = nullptr;
  std::unique_ptr<features::ConditionEncoder> encoder_;  // from the first condition() on
  models::SparseStructureDecoder decoder_ = nullptr;
};

}  // namespace anigen::pipeline
