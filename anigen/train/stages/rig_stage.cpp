#include "anigen/train/stages/rig_stage.h"

#include <cmath>

#include "anigen/asset/skeleton.h"
#include "anigen/metrics/published_protocols.h"

namespace anigen::train {

namespace {

using torch::Tensor;

constexpr char kModel[] = "model", kShortestTree[] = "shortest tree", kNearestBone[] = "nearest bone";

// Each point wholly on the bone whose segment is nearest. @param points [N, 3] @param bones [K, 6] @return [N, K]
metrics::SkinMatrix nearest_bone(const Tensor& points, const Tensor& bones) {
  const Tensor head = bones.narrow(1, 0, 3).to(torch::kFloat64), way = bones.narrow(1, 3, 3).to(torch::kFloat64) - head;
  const Tensor offset = points.to(torch::kFloat64).unsqueeze(1) - head.unsqueeze(0);  // [N, K, 3]
  const Tensor along = ((offset * way).sum(-1) / way.square().sum(-1).clamp_min(1e-12)).clamp(0.0, 1.0).unsqueeze(-1);
  const Tensor nearest = (offset - along * way).square().sum(-1).argmin(1);
  return matrix_of(torch::one_hot(nearest, bones.size(0)));
}

Values connectivity_values(const metrics::SkinMatrix& chances, const metrics::SkinMatrix& chosen,
                           const metrics::SkinMatrix& truth) {
  const auto parents = metrics::anymate_connectivity(chosen, truth);
  return {{"ce", metrics::anymate_connectivity(chances, truth).cross_entropy},
          {"precision", parents.precision},
          {"recall", parents.recall}};
}

Values skinning_values(const metrics::SkinMatrix& weights, const metrics::SkinMatrix& truth) {
  const auto score = metrics::anymate_skin(weights, truth);
  return {{"ce", score.cross_entropy}, {"cos", 1.0 - score.cos_loss},          {"mae", score.mae},
          {"l1", score.mean_l1},       {"precision", score.overlap.precision}, {"recall", score.overlap.recall}};
}

}  // namespace

metrics::SkinMatrix matrix_of(const Tensor& matrix) {
  const Tensor rows = matrix.detach().to(torch::kCPU, torch::kFloat64).contiguous();
  return Eigen::Map<const metrics::SkinMatrix>(rows.data_ptr<double>(), rows.size(0), rows.size(1));
}

metrics::SkinMatrix parent_rows(const std::vector<int>& parents) {
  const auto count = static_cast<Eigen::Index>(parents.size());
  metrics::SkinMatrix rows = metrics::SkinMatrix::Zero(count, count);
  for (Eigen::Index j = 0; j < count; ++j) {
    const int parent = parents[static_cast<std::size_t>(j)];
    rows(j, parent < 0 ? j : parent) = 1.0;
  }
  return rows;
}

void RigScores::add_joints(const std::string& id, const std::vector<Eigen::Vector3d>& predicted,
                           const std::vector<Eigen::Vector3d>& truth) {
  const metrics::AnymateJointScore score = metrics::anymate_joint(predicted, truth);
  const bool computed = score.not_computed.empty();
  const double missing = std::nan("");
  lines_.push_back({id,
                    kModel,
                    {{"cd", computed ? score.cd : missing},
                     {"emd", computed ? score.emd.cost : missing},
                     {"precision", computed ? score.precision : missing},
                     {"recall", computed ? score.recall : missing},
                     {"joints", static_cast<double>(predicted.size())},
                     {"skipped", computed ? 0.0 : 1.0}},
                    score.not_computed});
}

void RigScores::add_connectivity(const std::string& id, const metrics::SkinMatrix& chances,
                                 const metrics::SkinMatrix& chosen, const metrics::SkinMatrix& truth,
                                 const std::vector<Eigen::Vector3d>& joints) {
  lines_.push_back({id, kModel, connectivity_values(chances, chosen, truth)});
  const metrics::SkinMatrix shortest = parent_rows(shortest_tree(joints));
  lines_.push_back({id, kShortestTree, connectivity_values(shortest, shortest, truth)});
}

void RigScores::add_skinning(const std::string& id, const Tensor& predicted, const Tensor& truth, const Tensor& points,
                             const Tensor& bones) {
  const metrics::SkinMatrix wanted = matrix_of(truth);
  lines_.push_back({id, kModel, skinning_values(matrix_of(predicted), wanted)});
  lines_.push_back({id, kNearestBone, skinning_values(nearest_bone(points, bones), wanted)});
}

Values RigScores::means() const {
  RunningMeans means;
  for (const Line& line : lines_) {
    const std::string prefix = line.method == kModel ? "" : line.method == kShortestTree ? "tree_" : "nearest_";
    for (const auto& [name, value] : line.values) means.add(prefix + name, value);
  }
  return means.means();
}

CsvTable RigScores::table() const {
  CsvTable table;
  table.columns = {"id", "method", "failure"};
  if (!lines_.empty()) {
    for (const auto& [name, value] : lines_.front().values) table.columns.push_back(name);
  }
  for (const Line& line : lines_) {
    std::vector<std::string> row = {line.id, line.method, line.failure};
    for (const auto& [name, value] : line.values) row.push_back(std::isfinite(value) ? Json(value).dump() : "");
    table.rows.push_back(std::move(row));
  }
  return table;
}

void require_one_replica(const StageRequest& request, const std::string& family) {
  if (request.trainer.replicas == 1) return;
  throw NotSupportedError(request.file, "/trainer/args/replicas", "several replicas of " + family + "'s models");
}

}  // namespace anigen::train
