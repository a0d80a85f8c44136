#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/table.h"
#include "anigen/metrics/skin_metrics.h"
#include "anigen/nn/torch.h"
#include "anigen/train/metrics_log.h"
#include "anigen/train/options.h"
#include "anigen/train/stage.h"

namespace anigen::train {

/// Anymate's metrics (reference anymate-baselines.md, 6) of a method that finds joints, their parents or weights, over
/// samples, and of what looks at nothing: the shortest tree through the joints, the nearest bone. Everything is in
/// Anymate's frame, whatever the method's own, so that all methods stand in one table.
class RigScores {
 public:
  /// "cd", "emd", "precision", "recall", "joints" (their number) and "skipped": 1 with fewer than two joints, which
  /// are in no mean of the others.
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
  };
  std::vector<Line> lines_;
};

/// Parents as one-hot rows, a root its own. @param parents [J], -1 for a root
metrics::SkinMatrix parent_rows(const std::vector<int>& parents);

/// A tensor [N, M] of any device and type as a matrix.
metrics::SkinMatrix matrix_of(const torch::Tensor& matrix);

/// A stage of a model that rigs given meshes: its held-out assets are scored one by one. Modules draw from LibTorch's
/// default generator, which every step seeds, so there can be no replicas.
class RigStage : public Stage {
 public:
  Values evaluate() override;                                 ///< means of the scores
  void sample(const std::filesystem::path& folder) override;  ///< scores.csv: the metrics of each held-out asset
  /// @throws NotSupportedError
  std::unique_ptr<Stage> replica() const override;

 protected:
  /// @param family whose models these are, for messages @param held_out assets @param most of them to look at; 0: all
  RigStage(std::string family, std::size_t held_out, std::int64_t most);
  /// Of the first so many held-out assets. @post the model is in training mode
  virtual RigScores scores(std::size_t assets) = 0;

 private:
  std::string family_;
  std::size_t looked_at_;
};

/// The only model of a config, and where its arguments stand.
struct OnlyModel {
  std::string name;
  const Json* args;
  std::string pointer;  ///< JSON pointer of the arguments
};

/// @param top the config @throws InputError unless there is exactly one model, of this class, with arguments
OnlyModel read_only_model(ConfigReader& top, const std::string& class_name);

/// @throws NotSupportedError for several replicas @param family whose models these are
void require_one_replica(const TrainerOptions& trainer, const std::string& file, const std::string& family);

}  // namespace anigen::train
