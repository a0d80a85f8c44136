#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/geometry/sampling.h"

namespace anigen::geometry {

namespace {

double path_length(const std::vector<Eigen::Vector3d>& points, const std::vector<std::uint32_t>& order) {
  double length = 0.0;
  for (std::size_t i = 1; i < order.size(); ++i) length += (points[order[i]] - points[order[i - 1]]).norm();
  return length;
}

TEST(SpaceCurve, VisitsEveryPointOnceAndNeighboursTogether) {
  Rng rng(1, "points");
  std::vector<Eigen::Vector3d> points;
  std::vector<std::uint32_t> as_given;
  for (std::uint32_t i = 0; i < 2000; ++i) {
    points.emplace_back(rng.uniform(), rng.uniform(), rng.uniform());
    as_given.push_back(i);
  }
  const std::vector<std::uint32_t> order = along_curve(points);
  std::vector<std::uint32_t> sorted = order;
  std::sort(sorted.begin(), sorted.end());
  EXPECT_EQ(sorted, as_given);
  // Random order steps by 0.66 on average; 2,000 points are about 0.08 apart.
  EXPECT_LT(path_length(points, order), 0.25 * path_length(points, as_given));
}

TEST(SpaceCurve, DegenerateBoxesKeepTheOrder) {
  using Order = std::vector<std::uint32_t>;
  EXPECT_TRUE(along_curve({}).empty());
  EXPECT_EQ(along_curve({{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}), (Order{0, 1, 2}));
  constexpr double kHuge = std::numeric_limits<double>::max();
  EXPECT_EQ(along_curve({{-kHuge, 0, 0}, {kHuge, 0, 0}}).size(), 2u);
  EXPECT_EQ(along_curve({{0, 0, 0}, {std::numeric_limits<double>::denorm_min(), 0, 0}}).size(), 2u);
}

}  // namespace

namespace {

/// A unit square in two triangles of unequal size, and a face without area.
const std::vector<Eigen::Vector3f> kVertices{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0.5f, 0}};
const std::vector<Triangle> kFaces{{0, 1, 2}, {0, 2, 4}, {4, 2, 3}, {0, 0, 1}};

TEST(SurfaceSampling, ProbabilitiesAreClampedAreas) {
  const std::vector<double> p = face_probabilities(kVertices, kFaces);
  EXPECT_NEAR(p[0], 0.5, 1e-9);
  EXPECT_NEAR(p[1], 0.25, 1e-9);
  EXPECT_NEAR(p[2], 0.25, 1e-9);
  EXPECT_NEAR(p[3], 1e-12, 1e-15);  // clamped to 1e-12, never zero
  EXPECT_GT(p[3], 0.0);
}

TEST(SurfaceSampling, UniformWhenAnAreaIsNotFinite) {
  std::vector<Eigen::Vector3f> vertices = kVertices;
  vertices[3].x() = std::numeric_limits<float>::quiet_NaN();
  for (const double p : face_probabilities(vertices, kFaces)) EXPECT_EQ(p, 0.25);
}

TEST(SurfaceSampling, FacesAreDrawnByAreaAndPointsEvenlyOverTheSurface) {
  Rng rng(11, "sampling");
  constexpr std::size_t kCount = 40'000;
  const std::vector<SurfacePoint> points = sample_surface(kVertices, kFaces, kCount, rng);
  std::array<double, 4> faces{};
  std::array<double, 16> cells{};  // a 4 × 4 grid over the square
  for (const SurfacePoint& point : points) {
    ASSERT_GE(point.barycentric.minCoeff(), 0.0);
    ASSERT_NEAR(point.barycentric.sum(), 1.0, 1e-12);
    faces[static_cast<std::size_t>(point.face)] += 1.0 / kCount;
    const Eigen::Vector3d at = position(point, kVertices, kFaces);
    const auto cell = [](double x) { return std::min<std::size_t>(3, static_cast<std::size_t>(4 * x)); };
    cells[4 * cell(at.y()) + cell(at.x())] += 1.0 / kCount;
  }
  // Five standard deviations of a binomial share with p = 1/2 and p = 1/16.
  EXPECT_NEAR(faces[0], 0.5, 5 * std::sqrt(0.25 / kCount));
  EXPECT_NEAR(faces[1], 0.25, 5 * std::sqrt(0.1875 / kCount));
  EXPECT_EQ(faces[3], 0.0);
  for (const double share : cells) EXPECT_NEAR(share, 1.0 / 16, 5 * std::sqrt(0.0586 / kCount));
}

TEST(SurfaceSampling, BarycentricsFollowThePublishedFormulaInTheStreamsOrder) {
  Rng rng(5, "one"), same(5, "one");
  const std::vector<SurfacePoint> points = sample_surface({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}, 3, rng);
  for (const SurfacePoint& point : points) {
    same.uniform();  // the face
    const double u = same.uniform(), v = same.uniform();
    EXPECT_DOUBLE_EQ(point.barycentric[0], 1 - std::sqrt(u));
    EXPECT_DOUBLE_EQ(point.barycentric[1], std::sqrt(u) * (1 - v));
    EXPECT_DOUBLE_EQ(point.barycentric[2], std::sqrt(u) * v);
  }
}

TEST(SurfaceSampling, TheSameSeedGivesTheSameFirstPoints) {
  Rng a(9, "seed"), b(9, "seed"), c(10, "seed");
  const auto first = sample_surface(kVertices, kFaces, 5, a), second = sample_surface(kVertices, kFaces, 50, b);
  const auto other = sample_surface(kVertices, kFaces, 5, c);
  bool differs = false;
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].face, second[i].face);
    EXPECT_EQ(first[i].barycentric, second[i].barycentric);
    differs = differs || first[i].barycentric != other[i].barycentric;
  }
  EXPECT_TRUE(differs);
}

TEST(SurfaceSampling, RefusesWhatHasNoSurface) {
  Rng rng(1, "x");
  EXPECT_THROW(sample_surface(kVertices, {}, 1, rng), InputError);
  EXPECT_THROW(sample_surface(kVertices, {{0, 1, 5}}, 1, rng), InputError);
  EXPECT_TRUE(sample_surface(kVertices, {}, 0, rng).empty());
}

TEST(InterpolateSkin, MixesTheCornersRowsByBarycentrics) {
  SkinWeights weights;
  weights.append_row({{0, 1.0f}});
  weights.append_row({{0, 0.5f}, {1, 0.5f}});
  weights.append_row({{2, 1.0f}});
  const std::vector<SurfacePoint> points{{0, {0.2, 0.4, 0.4}}, {0, {0, 0, 1}}};
  const SkinWeights mixed = interpolate_skin(weights, {{0, 1, 2}}, points);
  const std::vector<float> dense = to_dense(mixed, 3);
  const std::vector<float> expected{0.4f, 0.2f, 0.4f, 0, 0, 1};
  ASSERT_EQ(dense.size(), expected.size());
  for (std::size_t i = 0; i < dense.size(); ++i) EXPECT_NEAR(dense[i], expected[i], 1e-6) << i;
}

TEST(InterpolateSkin, RepairsEmptyRowsAndRefusesMissingOnes) {
  SkinWeights weights;
  for (int i = 0; i < 3; ++i) weights.append_row({});
  const SkinWeights mixed = interpolate_skin(weights, {{0, 1, 2}}, {{0, {0.3, 0.3, 0.4}}});
  ASSERT_EQ(mixed.rows(), 1u);
  ASSERT_EQ(mixed.row_size(0), 1u);
  EXPECT_EQ(mixed.row(0)[0].joint, 0);
  EXPECT_EQ(mixed.row(0)[0].weight, 1.0f);
  EXPECT_THROW(interpolate_skin(weights, {{0, 1, 3}}, {{0, {1, 0, 0}}}), InputError);
  EXPECT_THROW(interpolate_skin(weights, {{0, 1, 2}}, {{1, {1, 0, 0}}}), InputError);
}

}  // namespace

}  // namespace anigen::geometry
