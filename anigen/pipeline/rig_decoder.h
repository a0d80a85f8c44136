#pragma once
#include <filesystem>
#include <string>

#include "anigen/asset/asset.h"
#include "anigen/fields/skeleton_field.h"
#include "anigen/geometry/vote_clustering.h"
#include "anigen/models/structured_latent_runs.h"

namespace anigen::pipeline {

/// The decoder of stage 3 at work on one asset at a time: structured latents become a rigged asset (paper 3.3;
/// reference autoencoders.md, 3.5–3.9), grouped as its run's variant groups.
class RigDecoder {
 public:
  /// @param grouping of votes by mean shift
  /// @throws InputError when arguments or weights do not fit, or the run trained the shape alone
  RigDecoder(const models::RunModel& found, torch::Device device, const geometry::MeanShiftOptions& grouping);

  const models::StructuredLatentDecoderOptions& options() const { return decoder_->options(); }

  struct Decoded {
    Asset asset;
    fields::SkeletonField votes;  ///< of the skeleton voxels, with the confidence that grouping took
  };
  /// @param latents a batch of one, as the encoder writes them: not normalised
  /// @param given skeleton to decode weights for instead of the grouped one; may be null
  /// @throws InputError when there is no surface or no joint
  Decoded decode(const models::PerStream<sparse::SparseTensor>& latents, const fields::SkeletonTensors* given,
                 const std::string& name);

 private:
  models::StructuredLatentVariant variant_;
  models::StructuredLatentDecoder decoder_ = nullptr;
};

}  // namespace anigen::pipeline
