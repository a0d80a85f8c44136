#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/models/skin_autoencoder.h"

namespace anigen::pipeline {

/// A trained skin auto-encoder used as it is judged: skin weights are encoded into a few numbers per vertex and
/// decoded again (paper 3.3.1; reference autoencoders.md, 1).
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
  models::SkinAutoEncoder model_ = nullptr;
};

}  // namespace anigen::pipeline
