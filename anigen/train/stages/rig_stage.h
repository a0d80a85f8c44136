#pragma once
#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/table.h"
#include "anigen/metrics/skin_metrics.h"
#include "anigen/train/metrics_log.h"
#include "anigen/train/stages/stages.h"

namespace anigen::train {

/// Anymate's metrics (docs/reference/anymate.md, 6) of a method that finds joints, their parents or weights, over
/// samples, and of what looks at nothing: the shortest tree through the joints, the nearest bone. Everything is in
/// Anymate's frame, whatever the method's own, so that all methods stand in one table.
class RigScores {
 public:
  /// "cd", "emd", "precision", "recall", "joints" (number), "skipped": 1 with fewer than two joints, in no other mean.
  void add_joints(const std::string& id, const std::vector<Eigen::Vector3d>& predicted,
                  const std::vector<Eigen::Vector3d>& truth);

  /// "ce" of the probabilities, "precision" and "recall" of the parents. Rows are joints, columns their parents, a root
  /// its own. @param chances [J, J] rows of probabilities @param chosen [J, J] those whose largest entries are the
  /// parents; the same where parents are what is likeliest @param truth [J, J] one-hot @param joints [J]
  void add_connectivity(const std::string& id, const metrics::SkinMatrix& chances, const metrics::SkinMatrix& chosen,
                        const metrics::SkinMatrix& truth, const std::vector<Eigen::Vector3d>& joints);

  /// "ce", "cos" (the cosine), "mae", "l1", "precision", "recall".
  /// @param predicted, truth [N, K] weights of bones at points @param points [N, 3] @param bones [K, 6]
  void add_skinning(const std::string& id, const torch::Tensor& predicted, const torch::Tensor& truth,
                    const torch::Tensor& points, const torch::Tensor& bones);

  Values means() const;    ///< those of the baseline begin with "tree_" or "nearest_"
  CsvTable table() const;  ///< a line per sample and method ("model", "shortest tree", "nearest bone"): id, method, …

 private:
  struct Line {
    std::string id, method;
    Values values;
    std::string failure = {};  // why there are no scores
  };
  std::vector<Line> lines_;
};

/// Parents as one-hot rows, a root its own. @param parents [J], -1 for a root
metrics::SkinMatrix parent_rows(const std::vector<int>& parents);

/// A tensor [N, M] of any device and type as a matrix.
metrics::SkinMatrix matrix_of(const torch::Tensor& matrix);

/// Frame of the stages of learned riggers: one model learns the task that its options name, and is judged on held-out
/// assets, which are scored one by one. Modules draw from LibTorch's own generator, seeded per step: no replicas.
/// @tparam Model a module holder with a constructor (options) @tparam Datasets {train, held_out or null}
/// @tparam Draws a data::Batch with `samples` @tparam Options with eval_max_assets
template <typename Model, typename Datasets, typename Draws, typename Options>
class RigStage : public Stage {
 public:
  using Samples = decltype(Draws::samples);

  /// @param family whose models these are, for messages @param purpose of the random draws
  template <typename ModelOptions>
  RigStage(const char* family, const char* purpose, const ModelOptions& model, const Options& options, Datasets data,
           std::string model_name, torch::Device device)
      : options_(options),
        device_(device),
        model_(model),
        family_(family),
        purpose_(purpose),
        data_(std::move(data)),
        model_name_(std::move(model_name)) {
    model_->to(device_);
    log::info("{} samples to train on, {} held out", data_.train->samples(),
              data_.held_out ? data_.held_out->samples() : 0);
  }

  std::vector<nn::NamedModel> models() const override { return {{model_name_, model_.ptr()}}; }
  const data::BatchSource& data() const override { return *data_.train; }
  Losses losses(const data::Batch& batch, const LossContext& context) final {
    torch::manual_seed(loss_generator(context, purpose_).current_seed());
    return loss(dynamic_cast<const Draws&>(batch).samples, context.step);
  }
  /// Means of the scores.
  Values evaluate() final { return scored().empty() ? Values() : scores().means(); }
  /// scores.csv: the metrics of each held-out asset.
  void sample(const std::filesystem::path& folder) final {
    if (!scored().empty()) write_file_atomically(folder / "scores.csv", to_csv(scores().table()));
  }
  /// @throws NotSupportedError
  std::unique_ptr<Stage> replica() const override {
    throw NotSupportedError("", "/trainer/args/replicas", "several replicas of " + family_ + "'s models");
  }

 protected:
  virtual Losses loss(const Samples& samples, std::int64_t step) = 0;
  /// Adds the scores of a held-out sample, in evaluation mode and without gradients. @param index names random draws
  virtual void score(const typename Samples::value_type& sample, std::uint64_t index, RigScores& scores) = 0;

  Options options_;
  torch::Device device_;
  Model model_;

 private:
  std::vector<std::size_t> scored() const {
    return looked_at(data_.held_out ? data_.held_out->samples() : 0, options_.eval_max_assets);
  }
  RigScores scores() {
    const torch::NoGradGuard no_grad;
    model_->eval();
    RigScores scores;
    for (const std::size_t i : scored()) score(data_.held_out->sample(i), i, scores);
    model_->train();
    return scores;
  }

  std::string family_, purpose_;
  Datasets data_;
  std::string model_name_;
};

/// @throws NotSupportedError for several replicas of `family`'s models
void require_one_replica(const StageRequest& request, const std::string& family);

}  // namespace anigen::train
