#pragma once
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/csv.h"
#include "anigen/models/anymate/collate.h"
#include "anigen/models/anymate/model.h"
#include "anigen/train/metrics_log.h"

namespace anigen::train {

/// Anymate's metrics of one model over samples, and of what looks at nothing: the shortest tree through the joints, the
/// nearest bone. See AnymateStage for the names of metrics.
class AnymateScores {
 public:
  /// @param model in evaluation mode @param train_steps, joints of a denoiser
  AnymateScores(models::anymate::AnymateModelImpl& model, std::int64_t train_steps, std::int64_t joints,
                torch::Device device)
      : model_(model), train_steps_(train_steps), joints_(joints), device_(device) {}

  /// @param index names the random draws of this sample
  void add(const models::anymate::AnymateSample& sample, std::uint64_t index);
  Values means() const;    ///< those of the baseline begin with "tree_" or "nearest_"
  CsvTable table() const;  ///< a line per sample and method ("model", "shortest tree", "nearest bone"): id, method, …

 private:
  struct Line {
    std::string id, method;
    Values values;
  };
  void add_joints(const models::anymate::AnymateSample& sample, const torch::Tensor& latents, std::uint64_t index);
  void add_connectivity(const models::anymate::AnymateBatch& batch, const torch::Tensor& latents);
  void add_skinning(const models::anymate::AnymateBatch& batch, const torch::Tensor& latents);

  models::anymate::AnymateModelImpl& model_;
  std::int64_t train_steps_, joints_;
  torch::Device device_;
  std::vector<Line> lines_;
};

}  // namespace anigen::train
