#pragma once
#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/csv.h"
#include "anigen/eval/skin/skin_matrix.h"
#include "anigen/nn/torch.h"
#include "anigen/train/metrics_log.h"

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
  void add_connectivity(const std::string& id, const eval::SkinMatrix& chances, const eval::SkinMatrix& chosen,
                        const eval::SkinMatrix& truth, const std::vector<Eigen::Vector3d>& joints);

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
eval::SkinMatrix parent_rows(const std::vector<int>& parents);

/// A tensor [N, M] of any device and type as a matrix.
eval::SkinMatrix matrix_of(const torch::Tensor& matrix);

}  // namespace anigen::train
