// Anymate's metrics of joints and of connectivity, and the skeleton it grows from predicted connectivity.
#include "anigen/metrics/chamfer.h"
#include "anigen/metrics/matching.h"
#include "anigen/metrics/published_protocols.h"
#include "anigen/metrics/wasserstein.h"
#include "tests/parity/eigen_tensors.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using Points = std::vector<Eigen::Vector3d>;

double exact_emd(const Points& a, const Points& b) {
  Eigen::MatrixXd cost(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < b.size(); ++k)
      cost(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = (a[i] - b[k]).norm();
  }
  return metrics::exact_transport(cost, metrics::uniform_masses(a.size()), metrics::uniform_masses(b.size())).cost;
}

/// Central differences of the Chamfer distance in every predicted coordinate: evaluation has no backward pass.
torch::Tensor chamfer_slopes(const Points& predicted, const Points& truth) {
  const double step = 1e-6;
  Eigen::MatrixXd result(predicted.size(), 3);
  Points moved = predicted;
  for (std::size_t i = 0; i < predicted.size(); ++i) {
    for (int k = 0; k < 3; ++k) {
      moved[i][k] = predicted[i][k] + step;
      const double above = metrics::anymate_joint(moved, truth).cd;
      moved[i][k] = predicted[i][k] - step;
      const double below = metrics::anymate_joint(moved, truth).cd;
      moved[i][k] = predicted[i][k];
      result(static_cast<Eigen::Index>(i), k) = (above - below) / (2.0 * step);
    }
  }
  return tensor(result);
}

void run_joint(Fixture& fixture) {
  const double threshold = fixture.config().at("threshold");
  Eigen::Vector4d sum = Eigen::Vector4d::Zero();
  int pairs = 0;
  for (; fixture.has_input("q" + std::to_string(pairs) + ".pred"); ++pairs) {
    const std::string pair = "q" + std::to_string(pairs) + ".";
    const Points predicted = points(fixture.input(pair + "pred")), truth = points(fixture.input(pair + "gt"));
    const metrics::AnymateJointScore score = metrics::anymate_joint(predicted, truth, threshold);
    fixture.check_true(pair + "computed", score.not_computed.empty());
    fixture.check(pair + "cd", scalar(score.cd));
    fixture.check(pair + "emd", scalar(score.emd.cost));
    fixture.check(pair + "plan_mass", scalar(score.emd.plan_mass));
    fixture.check(pair + "precision", scalar(score.precision));
    fixture.check(pair + "recall", scalar(score.recall));
    fixture.check(pair + "emd_exact", scalar(exact_emd(predicted, truth)));
    sum += Eigen::Vector4d(score.cd, score.emd.cost, score.precision, score.recall);
    if (pairs == 0) fixture.check("grad_cd_q0", chamfer_slopes(predicted, truth));
  }
  fixture.check("mean", tensor(sum / pairs).flatten());
}

void run_connectivity(Fixture& fixture) {
  const Points joints = points(fixture.input("joints")), other = points(fixture.input("joints2"));
  const Eigen::MatrixXd predicted = matrix(fixture.input("conn")), truth = matrix(fixture.input("conn_gt"));
  const std::vector<int> indices = ints(fixture.input("vox"));
  std::vector<std::array<int, 3>> cells;
  for (std::size_t i = 0; i + 2 < indices.size(); i += 3) cells.push_back({indices[i], indices[i + 1], indices[i + 2]});
  const metrics::AnymateOccupancy inside(cells);

  const metrics::AnymateConnectivityScore score = metrics::anymate_connectivity(predicted, truth);
  fixture.check("precision", scalar(score.precision));
  fixture.check("recall", scalar(score.recall));
  fixture.check("cross_entropy", scalar(score.cross_entropy));
  fixture.check("cross_entropy_rows", tensor(metrics::anymate_cross_entropy(predicted, truth)).flatten());

  const metrics::AnymateTree skeleton = metrics::grow_anymate_tree(joints, predicted, inside);
  const metrics::AnymateTree skeleton_truth = metrics::grow_anymate_tree(joints, truth, inside);
  fixture.check("root", torch::tensor(skeleton.root, torch::kInt64));
  fixture.check("cost_matrix", tensor(skeleton.cost));
  fixture.check("parents", torch::tensor(skeleton.tree.parents, torch::kInt32));
  fixture.check("parents_gt", torch::tensor(skeleton_truth.tree.parents, torch::kInt32));
  const auto rignet = metrics::SkeletonProtocol::kRignet;
  fixture.check("bone2bone", scalar(metrics::skeleton_chamfer(skeleton.tree, skeleton_truth.tree, rignet).b2b));

  // The joints and connectivity of another skeleton against the true ones.
  const metrics::AnymateTree whole = metrics::grow_anymate_tree(other, matrix(fixture.input("conn2")), inside);
  const metrics::SkeletonChamfer chamfer = metrics::skeleton_chamfer(whole.tree, skeleton_truth.tree, rignet);
  const double threshold = fixture.config().at("fs_threshold");
  const metrics::JointMatch match = metrics::match_joints(other, joints, threshold);
  fixture.check("skeleton",
                torch::tensor({chamfer.j2j, chamfer.j2b, chamfer.b2b, match.iou, match.precision, match.recall},
                              torch::kFloat64));
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_metric_anymate_joint, anigen::test::run_joint)
ANIGEN_PARITY(ops_metric_anymate_connectivity, anigen::test::run_connectivity)
