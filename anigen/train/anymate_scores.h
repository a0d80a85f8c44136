#pragma once
#include <cstdint>

#include "anigen/models/anymate/collate.h"
#include "anigen/models/anymate/model.h"
#include "anigen/train/rig_scores.h"

namespace anigen::train {

/// Anymate's metrics of one of its models over samples. See AnymateStage for their names.
class AnymateScores {
 public:
  /// @param model in evaluation mode @param train_steps, joints of a denoiser
  AnymateScores(models::anymate::AnymateModelImpl& model, std::int64_t train_steps, std::int64_t joints,
                torch::Device device)
      : model_(model), train_steps_(train_steps), joints_(joints), device_(device) {}

  /// @param index names the random draws of this sample
  void add(const models::anymate::AnymateSample& sample, std::uint64_t index);
  const RigScores& scores() const { return scores_; }

 private:
  void add_joints(const models::anymate::AnymateSample& sample, const torch::Tensor& latents, std::uint64_t index);
  void add_connectivity(const models::anymate::AnymateBatch& batch, const torch::Tensor& latents);
  void add_skinning(const models::anymate::AnymateBatch& batch, const torch::Tensor& latents);

  models::anymate::AnymateModelImpl& model_;
  std::int64_t train_steps_, joints_;
  torch::Device device_;
  RigScores scores_;
};

}  // namespace anigen::train
