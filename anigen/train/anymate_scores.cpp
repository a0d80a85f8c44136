#include "anigen/train/anymate_scores.h"

#include <cmath>
#include <vector>

#include "anigen/eval/skeleton/anymate_connectivity.h"
#include "anigen/eval/skeleton/anymate_joint.h"
#include "anigen/eval/skin/skin_protocols.h"
#include "anigen/geometry/spanning_trees.h"
#include "anigen/models/anymate/connectivity.h"
#include "anigen/models/anymate/predicted_joints.h"
#include "anigen/models/anymate/skinning.h"
#include "anigen/train/loss_generator.h"

namespace anigen::train {
namespace {

using torch::Tensor;
namespace anymate = models::anymate;

std::vector<Eigen::Vector3d> points_of(const Tensor& points) {
  const Tensor rows = points.to(torch::kCPU, torch::kFloat64).contiguous();
  const double* values = rows.data_ptr<double>();
  std::vector<Eigen::Vector3d> list;
  for (std::int64_t i = 0; i < rows.size(0); ++i, values += 3) list.emplace_back(values[0], values[1], values[2]);
  return list;
}

eval::SkinMatrix matrix_of(const Tensor& matrix) {
  const Tensor rows = matrix.to(torch::kCPU, torch::kFloat64).contiguous();
  return Eigen::Map<const eval::SkinMatrix>(rows.data_ptr<double>(), rows.size(0), rows.size(1));
}

constexpr char kModel[] = "model", kShortestTree[] = "shortest tree", kNearestBone[] = "nearest bone";

// Each point wholly on the bone whose segment is nearest. @param points [N, 3] @param bones [K, 6] @return [N, K]
eval::SkinMatrix nearest_bone(const Tensor& points, const Tensor& bones) {
  const Tensor head = bones.narrow(1, 0, 3).to(torch::kFloat64), way = bones.narrow(1, 3, 3).to(torch::kFloat64) - head;
  const Tensor offset = points.to(torch::kFloat64).unsqueeze(1) - head.unsqueeze(0);  // [N, K, 3]
  const Tensor along = ((offset * way).sum(-1) / way.square().sum(-1).clamp_min(1e-12)).clamp(0.0, 1.0).unsqueeze(-1);
  const Tensor nearest = (offset - along * way).square().sum(-1).argmin(1);
  return matrix_of(torch::one_hot(nearest, bones.size(0)));
}

// Parents of the shortest tree as one-hot rows, the root its own.
eval::SkinMatrix shortest_tree_rows(const std::vector<Eigen::Vector3d>& joints) {
  const std::vector<int> parents = geometry::shortest_tree(joints);
  const auto count = static_cast<Eigen::Index>(joints.size());
  eval::SkinMatrix rows = eval::SkinMatrix::Zero(count, count);
  for (Eigen::Index j = 0; j < count; ++j) {
    const int parent = parents[static_cast<std::size_t>(j)];
    rows(j, parent < 0 ? j : parent) = 1.0;
  }
  return rows;
}

}  // namespace

void AnymateScores::add(const anymate::AnymateSample& sample, std::uint64_t index) {
  const torch::NoGradGuard no_grad;
  const anymate::AnymateBatch batch = anymate::collate({sample}, {sample.joints.size(0), sample.bones.size(0)});
  const Tensor latents = model_.encode(batch.points_cloud.to(device_));
  switch (anymate::task_of(model_.options().decoder)) {
    case anymate::Task::kConnectivity:
      return add_connectivity(batch, latents);
    case anymate::Task::kSkinning:
      return add_skinning(batch, latents);
    default:
      return add_joints(sample, latents, index);
  }
}

void AnymateScores::add_joints(const anymate::AnymateSample& sample, const Tensor& latents, std::uint64_t index) {
  anymate::JointPrediction options;
  options.train_steps = train_steps_;
  options.noise = torch::randn({1, joints_, 3}, numbered_generator(0, "anymate held-out noise", index)).to(device_);
  options.cells = sample.vox;
  const std::vector<Eigen::Vector3d> predicted = points_of(anymate::predicted_joints(model_, latents, options));
  const eval::AnymateJointScore score = eval::anymate_joint(predicted, points_of(sample.joints));
  const bool computed = score.not_computed.empty();
  const double missing = std::nan("");
  lines_.push_back({sample.name,
                    kModel,
                    {{"cd", computed ? score.cd : missing},
                     {"emd", computed ? score.emd.cost : missing},
                     {"precision", computed ? score.precision : missing},
                     {"recall", computed ? score.recall : missing},
                     {"joints", static_cast<double>(predicted.size())},
                     {"skipped", computed ? 0.0 : 1.0}}});
}

void AnymateScores::add_connectivity(const anymate::AnymateBatch& batch, const Tensor& latents) {
  const Tensor logits = model_.decoder<anymate::ConnectivityImpl>().forward(latents, batch.joints.to(device_),
                                                                            batch.joints_mask.to(device_));
  const eval::SkinMatrix truth = matrix_of(batch.conns[0]);
  const auto add_line = [&](const char* method, const eval::SkinMatrix& parents) {
    const auto score = eval::anymate_connectivity(parents, truth);
    lines_.push_back({batch.names.front(),
                      method,
                      {{"ce", score.cross_entropy}, {"precision", score.precision}, {"recall", score.recall}}});
  };
  add_line(kModel, matrix_of(logits[0].softmax(-1)));
  add_line(kShortestTree, shortest_tree_rows(points_of(batch.joints[0])));
}

void AnymateScores::add_skinning(const anymate::AnymateBatch& batch, const Tensor& latents) {
  if (!batch.skins.defined()) throw InputError("", batch.names.front() + "/skins_index", "the sample has no weights");
  anymate::SkinningInput input;
  input.latents = latents;
  input.points = batch.points_cloud.to(device_);
  input.bones = batch.bones.to(device_);
  input.mask = batch.bones_mask.to(device_);
  const Tensor predicted = model_.decoder<anymate::SkinningImpl>().forward(input)[0].softmax(-1);
  const eval::SkinMatrix truth = matrix_of(batch.skins[0]);
  const auto add_line = [&](const char* method, const eval::SkinMatrix& weights) {
    const auto score = eval::anymate_skin(weights, truth);
    lines_.push_back({batch.names.front(),
                      method,
                      {{"ce", score.cross_entropy},
                       {"cos", 1.0 - score.cos_loss},
                       {"mae", score.mae},
                       {"l1", score.mean_l1},
                       {"precision", score.overlap.precision},
                       {"recall", score.overlap.recall}}});
  };
  add_line(kModel, matrix_of(predicted));
  add_line(kNearestBone, nearest_bone(batch.points_cloud[0].narrow(1, 0, 3), batch.bones[0]));
}

Values AnymateScores::means() const {
  RunningMeans means;
  for (const Line& line : lines_) {
    const std::string prefix = line.method == kModel ? "" : line.method == kShortestTree ? "tree_" : "nearest_";
    for (const auto& [name, value] : line.values) means.add(prefix + name, value);
  }
  return means.means();
}

CsvTable AnymateScores::table() const {
  CsvTable table;
  table.columns = {"id", "method", "failure"};
  if (!lines_.empty()) {
    for (const auto& [name, value] : lines_.front().values) table.columns.push_back(name);
  }
  for (const Line& line : lines_) {
    std::vector<std::string> row = {line.id, line.method, ""};
    for (const auto& [name, value] : line.values) row.push_back(std::isfinite(value) ? Json(value).dump() : "");
    table.rows.push_back(std::move(row));
  }
  return table;
}

}  // namespace anigen::train
