#include "anigen/eval/pair/pair_groups.h"
#include "anigen/eval/skin/deformation.h"
#include "anigen/eval/skin/skin_matching.h"
#include "anigen/eval/skin/skin_protocols.h"
#include "anigen/eval/skin_metrics.h"
#include "anigen/eval/surface/skin_transfer.h"

namespace anigen::eval {

void add_skin_metrics(const ComparedShapes& shapes, const Eigen::MatrixXd& plan, const PairSettings& settings,
                      PairResult& result) {
  const io::RiggedShape& predicted = shapes.predicted;
  const io::RiggedShape& truth = shapes.truth;
  std::vector<Eigen::Vector3d> vertices;
  for (const Eigen::Vector3f& vertex : truth.mesh.vertices) vertices.push_back(vertex.cast<double>());

  SkinWeights moved;
  if (predicted.has_surface()) {
    moved = transfer_skin_to_mesh(predicted.mesh, predicted.skin, truth.mesh);
  } else {
    std::vector<Eigen::Vector3d> points;
    for (const Eigen::Vector3f& vertex : predicted.mesh.vertices) points.push_back(vertex.cast<double>());
    moved = transfer_skin_by_vertex(points, predicted.skin, vertices);
    result.notes.push_back("predicted weights taken from the nearest point: the prediction has no faces");
  }

  const std::size_t count = vertices.size(), joints = truth.joints.size();
  const std::vector<double> matched = matched_weights(moved, plan);
  const std::vector<float> dense_truth = to_dense(truth.skin, joints);
  const SkinScore score = score_skin(single_precision(matched), dense_truth, count, joints).mean;
  result.set("skin_l1", score.l1);
  result.set("skin_l2", score.l2);
  result.set("skin_kl", score.kl);

  const auto matched_matrix = skin_matrix(matched, count, joints);
  const SkinMatrix truth_matrix = skin_matrix(dense_truth, count, joints);
  const SkinOverlap overlap = rignet_skin_overlap(matched_matrix, truth_matrix);
  result.set("skin_precision", overlap.precision);
  result.set("skin_recall", overlap.recall);
  const AnymateSkinScore anymate = anymate_skin(matched_matrix, truth_matrix);
  result.set("skin_ce", anymate.cross_entropy);
  result.set("skin_cos", 1.0 - anymate.cos_loss);
  result.set("skin_mae", anymate.mae);

  DeformationOptions deformation;
  deformation.poses = settings.poses;
  deformation.seed = settings.seed;
  const DeformationError error =
      deformation_error(vertices, truth.joints, truth.skin, predicted.joints, moved, plan, deformation);
  result.set("deformation_error", error.mean);
  result.details["largest_deformation_error"] = error.max;
}

}  // namespace anigen::eval
