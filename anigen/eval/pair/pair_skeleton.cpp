#include "anigen/core/error.h"
#include "anigen/eval/pair/pair_groups.h"
#include "anigen/eval/skeleton/anymate_joint.h"
#include "anigen/eval/skeleton/connectivity.h"
#include "anigen/eval/skeleton/joint_matching.h"
#include "anigen/eval/skeleton/skeleton_chamfer.h"
#include "anigen/eval/skeleton/tree_edit_distance.h"
#include "anigen/eval/transport/skeleton_transport.h"
#include "anigen/eval/transport/wasserstein.h"

namespace anigen::eval {
namespace {

constexpr double kMarginalsAlmostKept = 1e-3;  ///< L1 of masses that sum to 1
constexpr double kAnymateBox = 2.0;            ///< longest side of its frame; ours is 1

void set_chamfer(const SkeletonChamfer& chamfer, const std::string& prefix, PairResult& result) {
  result.set(prefix + "j2j", chamfer.j2j);
  result.set(prefix + "j2b", chamfer.j2b);
  result.set(prefix + "b2b", chamfer.b2b);
}

}  // namespace

void add_skeleton_metrics(const ComparedShapes& shapes, PairResult& result) {
  const io::JointTree& predicted = shapes.predicted.joints;
  const io::JointTree& truth = shapes.truth.joints;
  for (const SkeletonProtocol protocol : kSkeletonProtocols) {
    const std::string prefix = protocol == SkeletonProtocol::kPaper ? "" : name(protocol) + ".";
    try {
      set_chamfer(skeleton_chamfer(predicted, truth, protocol), prefix, result);
    } catch (const InputError& error) {
      for (const char* key : {"j2j", "j2b", "b2b"}) result.skip(prefix + key, error.what());
    }
  }
  // The tolerance of joint matching is half the thickness of the true shape at each joint, where there is a shape.
  std::vector<double> tolerance(truth.size(), kFixedTolerance);
  if (shapes.truth.has_surface())
    tolerance = joint_tolerances(truth, geometry::RayCaster(shapes.truth.mesh));
  else
    result.notes.push_back("joints matched within 0.05: without a true surface there is no thickness to go by");
  const JointMatch match = match_joints(predicted, truth, tolerance);
  result.set("rignet.iou", match.iou);
  result.set("rignet.precision", match.precision);
  result.set("rignet.recall", match.recall);
  const ConnectivityScore bones = connectivity(predicted, truth, match.truth_of);
  result.set("connectivity_precision", bones.precision);
  result.set("connectivity_recall", bones.recall);
  result.set("joints", static_cast<double>(predicted.size()));
  result.set("joint_count_error", static_cast<double>(joint_count_error(predicted, truth)));
  if (const auto edits = tree_edit_distance(predicted, truth))
    result.set("tree_edit_distance", *edits);
  else
    result.skip("tree_edit_distance", "too many joints for it");
}

void add_transport_metrics(const ComparedShapes& shapes, const PairSettings& settings, PairResult& result) {
  const TransportOptions options = transport_options(settings);
  const SkeletonTransport transport = skeleton_transport(shapes.predicted.joints, shapes.truth.joints, options);
  result.set("wasserstein", options.sinkhorn ? transport.sinkhorn_wasserstein : transport.wasserstein);
  result.set("gromov_wasserstein",
             options.sinkhorn ? transport.entropic_gromov_wasserstein : transport.gromov_wasserstein);
  result.set("gw_lower_bound", transport.gw_lower_bound);
  result.set("fused_gromov_wasserstein", transport.fused_gromov_wasserstein);
  result.details["gw_start"] = options.sinkhorn ? "entropic" : transport.gw_start;
  result.details["fgw_start"] = transport.fgw_start;
  if (!options.sinkhorn) return;
  result.details["sinkhorn"] = {{"squared_wasserstein_gap", transport.sinkhorn_gap},
                                {"wasserstein_converged", transport.sinkhorn_converged},
                                {"gromov_wasserstein_marginal_error", transport.entropic_marginal_error}};
  if (!transport.sinkhorn_converged)
    result.notes.push_back("Sinkhorn's iterations for the Wasserstein distance stopped before their tolerance");
  if (!(transport.entropic_marginal_error < kMarginalsAlmostKept))
    result.notes.push_back(
        "Sinkhorn's scaling for the Gromov–Wasserstein distance left double precision and its plan was repaired: a "
        "larger "
        "--epsilon keeps it");
}

void add_anymate_metrics(const ComparedShapes& shapes, PairResult& result) {
  const auto doubled = [](std::vector<Eigen::Vector3d> points) {
    for (Eigen::Vector3d& point : points) point *= kAnymateBox;
    return points;
  };
  const std::vector<Eigen::Vector3d> predicted = doubled(shapes.predicted.joints.positions);
  const std::vector<Eigen::Vector3d> truth = doubled(shapes.truth.joints.positions);
  const AnymateJointScore score = anymate_joint(predicted, truth);
  if (!score.not_computed.empty()) return skip_group("anymate", score.not_computed, result);
  result.set("anymate_cd", score.cd);
  result.set("anymate_emd", score.emd.cost);
  result.set("anymate_precision", score.precision);
  result.set("anymate_recall", score.recall);
  result.set("anymate_emd_exact", wasserstein1(predicted, truth).distance);
}

}  // namespace anigen::eval
