#include "anigen/eval/align/normalization.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/eval/surface/surface_samples.h"
#include "tests/eval/align_shapes.h"

namespace anigen::eval {
namespace {

TEST(SurfaceMoments, OfASquareAreThoseOfTheIntegral) {
  Mesh square;
  square.vertices = {{1, 1, 5}, {3, 1, 5}, {3, 3, 5}, {1, 3, 5}, {100, 0, 0}};  // the last belongs to no face
  square.faces = {{0, 1, 2}, {0, 2, 3}};
  const SurfaceMoments moments = surface_moments(square);
  EXPECT_NEAR(moments.area, 4.0, 1e-12);
  EXPECT_LT((moments.centroid - Eigen::Vector3d(2, 2, 5)).norm(), 1e-12);
  EXPECT_NEAR(moments.rms_radius, std::sqrt(2.0 / 3.0), 1e-12);  // x² and y² each average 1/3
}

TEST(SurfaceMoments, AreWhatManySamplesEstimate) {
  const Mesh mesh = test::walker(6);
  const SurfaceMoments moments = surface_moments(mesh);
  const SurfaceSamples samples = sample_mesh(mesh, 200000, 1, "moments");
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : samples.points) centroid += p / 200000.0;
  double squared = 0.0;
  for (const Eigen::Vector3d& p : samples.points) squared += (p - centroid).squaredNorm() / 200000.0;
  EXPECT_LT((moments.centroid - centroid).norm(), 5e-3);  // four standard errors
  EXPECT_NEAR(moments.rms_radius, std::sqrt(squared), 5e-3);
}

TEST(Normalization, CentroidAndRmsDoNotChangeUnderSimilarities) {
  const Mesh mesh = test::walker(8);
  const Similarity reference = normalization(mesh, NormalizationMode::kCentroidRms);
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    const Similarity moved_by = test::random_similarity(seed);
    const Mesh moved = transformed(moved_by, mesh);
    const Similarity found = normalization(moved, NormalizationMode::kCentroidRms);
    // The same shape up to the rotation that is still to be found.
    EXPECT_NEAR(found.scale * moved_by.scale, reference.scale, 1e-5 * reference.scale);
    const Eigen::Vector3d p = mesh.vertices[17].cast<double>();
    EXPECT_NEAR(found(moved_by(p)).norm(), reference(p).norm(), 1e-5);
  }
}

TEST(Normalization, TessellationHardlyMattersAndUnevenSamplingNotAtAll) {
  // One face of a box in two triangles, then in many: the surface is the same.
  Mesh coarse;
  coarse.vertices = {{0, 0, 0}, {2, 0, 0}, {2, 1, 0}, {0, 1, 0}};
  coarse.faces = {{0, 1, 2}, {0, 2, 3}};
  Mesh fine;
  constexpr int kSteps = 12;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      const float u = std::pow(static_cast<float>(i) / kSteps, 3.0f);
      fine.vertices.emplace_back(2 * u, static_cast<float>(j) / kSteps, 0.0f);
    }
  }
  for (int i = 0; i < kSteps; ++i) {
    for (int j = 0; j < kSteps; ++j) {
      const int a = i * (kSteps + 1) + j, b = a + kSteps + 1;
      fine.faces.push_back({a, b, b + 1});
      fine.faces.push_back({a, b + 1, a + 1});
    }
  }
  const Similarity a = normalization(coarse, NormalizationMode::kCentroidRms);
  const Similarity b = normalization(fine, NormalizationMode::kCentroidRms);
  EXPECT_NEAR(a.scale, b.scale, 1e-6);
  EXPECT_LT((a.translation - b.translation).norm(), 1e-6);
}

TEST(Normalization, BoundingBoxBecomesTheUnitBox) {
  const Mesh mesh = transformed(test::random_similarity(3), test::walker(8));
  const Mesh unit = transformed(normalization(mesh, NormalizationMode::kBoundingBox), mesh);
  const Box box = bounding_box(unit.vertices);
  EXPECT_NEAR(box.longest_side(), 1.0, 1e-6);
  EXPECT_LT(box.center().norm(), 1e-6);
  const Similarity none = normalization(mesh, NormalizationMode::kNone);
  EXPECT_TRUE(none.matrix().isIdentity(0.0));
}

TEST(Normalization, ShapesWithoutSizeKeepTheirScale) {
  Mesh point;
  point.vertices = {{3, 4, 5}, {3, 4, 5}, {3, 4, 5}};
  point.faces = {{0, 1, 2}};
  for (const NormalizationMode mode : {NormalizationMode::kCentroidRms, NormalizationMode::kBoundingBox}) {
    const Similarity found = normalization(point, mode);
    EXPECT_EQ(found.scale, 1.0);
    EXPECT_LT(found({3, 4, 5}).norm(), 1e-12);
    EXPECT_EQ(normalization(std::vector<Eigen::Vector3d>{{3, 4, 5}}, mode).scale, 1.0);
  }
  // A needle: faces without area, but vertices with extent.
  Mesh needle;
  needle.vertices = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
  needle.faces = {{0, 1, 2}};
  EXPECT_NEAR(normalization(needle, NormalizationMode::kCentroidRms).scale, 1.0 / std::sqrt(2.0 / 3.0), 1e-12);
}

TEST(Normalization, RefusesBadInputAndKnowsItsWords) {
  EXPECT_THROW(normalization(Mesh{}, NormalizationMode::kCentroidRms), InputError);
  EXPECT_THROW(normalization(Mesh{}, NormalizationMode::kBoundingBox), InputError);
  EXPECT_THROW(normalization(std::vector<Eigen::Vector3d>{}, NormalizationMode::kNone), InputError);
  Mesh mesh = test::walker(4);
  mesh.vertices[7].z() = NAN;
  EXPECT_THROW(normalization(mesh, NormalizationMode::kCentroidRms), InputError);
  EXPECT_THROW(normalization(mesh, NormalizationMode::kNone), InputError);
  mesh = test::walker(4);
  mesh.faces[3][1] = 100000;
  EXPECT_THROW(surface_moments(mesh), InputError);
  for (const NormalizationMode mode :
       {NormalizationMode::kCentroidRms, NormalizationMode::kBoundingBox, NormalizationMode::kNone}) {
    EXPECT_EQ(normalization_mode(to_string(mode)), mode);
  }
  EXPECT_THROW(normalization_mode("sphere"), InputError);
}

}  // namespace
}  // namespace anigen::eval
