// Chamfer distances of skeleton pairs in the public conventions, and the edit distance of their trees.
#include "anigen/metrics/chamfer.h"
#include "anigen/metrics/tree_edit.h"
#include "tests/parity/eigen_tensors.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

torch::Tensor three(const metrics::SkeletonChamfer& score) {
  return torch::tensor({score.j2j, score.j2b, score.b2b}, torch::kFloat64);
}

std::int64_t spaced_count(const metrics::MetricSkeleton& skeleton) {
  return metrics::sample_count(metrics::spaced_samples(skeleton.bones));
}

void run_skeleton_chamfer(Fixture& fixture) {
  const Json& range = fixture.config().at("continuous_range");
  const double width = range.at(1).get<double>() - range.at(0).get<double>();
  for (int q = 0; fixture.has_input("q" + std::to_string(q) + ".joints_a"); ++q) {
    const std::string pair = "q" + std::to_string(q) + ".";
    const metrics::MetricSkeleton a =
        JointTree{points(fixture.input(pair + "joints_a")), ints(fixture.input(pair + "parents_a"))};
    const metrics::MetricSkeleton b =
        JointTree{points(fixture.input(pair + "joints_b")), ints(fixture.input(pair + "parents_b"))};
    fixture.check(pair + "unirig", three(metrics::skeleton_chamfer(a, b, metrics::SkeletonProtocol::kUnirig, width)));
    fixture.check(pair + "rignet", three(metrics::skeleton_chamfer(a, b, metrics::SkeletonProtocol::kRignet)));
    // The published distance functions by themselves: the merging of joints comes before them.
    fixture.check(pair + "puppeteer", three(metrics::spaced_chamfer(a, b)));
    fixture.check(pair + "num_samples", torch::tensor({spaced_count(a), spaced_count(b)}, torch::kInt64));

    const metrics::NearestBone bones_b(b.bones);
    std::vector<double> exact;
    for (const Eigen::Vector3d& joint : a.positions) exact.push_back(bones_b.distance(joint));
    fixture.check(pair + "exact_point_segment", torch::tensor(exact, torch::kFloat64));
    // The published function is off by its guards against division by zero, less than the tolerance.
    fixture.check(pair + "unirig_point_segment", torch::tensor(exact, torch::kFloat64));

    const auto edits = metrics::tree_edit_distance(a, b, metrics::ChildOrder::kIndex);
    fixture.check(pair + "edit", torch::tensor({static_cast<double>(edits.value())}, torch::kFloat64));
  }
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_metric_skeleton_chamfer, anigen::test::run_skeleton_chamfer)
