// Nearest points on meshes with attribute transfer, and the metrics of surface point sets.
#include "anigen/metrics/surface.h"

#include <string>

#include "anigen/geometry/nearest_surface.h"
#include "tests/parity/eigen_tensors.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

void check_nearest_points(Fixture& fixture, const std::string& mesh) {
  const std::vector<int> flat = ints(fixture.input(mesh + ".faces"));
  std::vector<Triangle> faces;
  for (std::size_t i = 0; i + 2 < flat.size(); i += 3) faces.push_back({flat[i], flat[i + 1], flat[i + 2]});
  const auto queries = points(fixture.input(mesh + ".points"));
  const auto found = geometry::NearestSurface(points(fixture.input(mesh + ".vertices")), faces).query(queries);

  const std::vector<int> unique = ints(fixture.expected(mesh + ".unique"));
  const std::vector<int> their_triangles = ints(fixture.expected(mesh + ".triangle"));
  const Eigen::MatrixXd their_barycentrics = matrix(fixture.expected(mesh + ".bary"));
  const Eigen::MatrixXd values = matrix(fixture.input(mesh + ".attrs"));
  const auto count = static_cast<Eigen::Index>(queries.size());
  Eigen::MatrixXd closest(count, 3), distance(count, 1), barycentrics(count, 3), attributes(count, values.cols());
  torch::Tensor triangle = torch::empty({count}, torch::kInt64), interior = torch::empty({count}, torch::kInt32);
  double sum = 0.0;
  for (Eigen::Index i = 0; i < count; ++i) {
    const auto row = static_cast<std::size_t>(i);
    const geometry::NearestPoint& point = found[row];
    closest.row(i) = point.position.transpose();
    distance(i, 0) = point.distance;
    sum += point.distance;
    // On a shared edge or corner any of its triangles is right; only interior points have one answer.
    const bool one_answer = unique[row] != 0;
    triangle[i] = one_answer ? point.at.face : their_triangles[row];
    barycentrics.row(i) = their_barycentrics.row(i);
    if (one_answer) barycentrics.row(i) = point.at.barycentric.transpose();
    if (one_answer || point.at.face == their_triangles[row]) {
      interior[i] = point.at.barycentric.minCoeff() > 1e-6 ? 1 : 0;
    } else {
      interior[i] = 0;
    }
    attributes.row(i).setZero();
    for (std::size_t k = 0; k < 3; ++k) {
      attributes.row(i) += point.at.barycentric[static_cast<Eigen::Index>(k)] *
                           values.row(faces[static_cast<std::size_t>(point.at.face)][k]);
    }
  }
  fixture.check(mesh + ".closest", tensor(closest));
  fixture.check(mesh + ".distance", tensor(distance).reshape({count}));
  fixture.check(mesh + ".triangle", triangle);
  fixture.check(mesh + ".unique", interior);
  fixture.check(mesh + ".bary", tensor(barycentrics));
  fixture.check(mesh + ".attrs", tensor(attributes));
  fixture.check(mesh + ".chamfer_p2s", scalar(sum / static_cast<double>(count)));
}

void run_point_to_mesh(Fixture& fixture) {
  const std::size_t meshes = fixture.config().at("meshes").size();
  for (std::size_t m = 0; m < meshes; ++m) check_nearest_points(fixture, "m" + std::to_string(m));
}

void run_point_clouds(Fixture& fixture) {
  const metrics::CloudDistances distances =
      metrics::cloud_distances(points(fixture.input("a")), points(fixture.input("b")));
  fixture.check("chamfer_l1", scalar(metrics::chamfer_l1(distances)));
  fixture.check("chamfer_l2", scalar(metrics::chamfer_l2(distances)));
  fixture.check("hausdorff", scalar(metrics::hausdorff(distances)));
  fixture.check("normal_consistency", scalar(metrics::normal_consistency(distances, points(fixture.input("na")),
                                                                         points(fixture.input("nb")))));
  std::vector<double> fscores, precisions, recalls;
  for (const double threshold : fixture.config().at("tau").get<std::vector<double>>()) {
    const metrics::FScore score = metrics::fscore(distances, threshold);
    fscores.push_back(score.fscore);
    precisions.push_back(score.precision);
    recalls.push_back(score.recall);
  }
  fixture.check("fscore", torch::tensor(fscores, torch::kFloat64));
  fixture.check("precision", torch::tensor(precisions, torch::kFloat64));
  fixture.check("recall", torch::tensor(recalls, torch::kFloat64));
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_metric_point_to_mesh, anigen::test::run_point_to_mesh)
ANIGEN_PARITY(ops_metric_surface_pointcloud, anigen::test::run_point_clouds)
