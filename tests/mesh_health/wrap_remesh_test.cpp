#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/primitives.h"
#include "anigen/mesh_health/check.h"
#include "anigen/mesh_health/limited.h"
#include "anigen/mesh_health/remesh.h"
#include "anigen/mesh_health/wrap.h"
#include "tests/geometry/mesh_shape.h"
#include "tests/mesh_health/shapes.h"

namespace anigen::mesh_health {
namespace {

constexpr CheckOptions kWatertight{true, true};

bool has(const MeshFigures& figures, const std::string& code) {
  return std::any_of(figures.findings.begin(), figures.findings.end(),
                     [&](const MeshFinding& finding) { return finding.code == code; });
}

TEST(Wrap, TwoCrossingCubesBecomeOneClosedManifold) {
  const Mesh cubes = test::together(test::cube(1.0f), test::cube(1.0f, {0.5f, 0.5f, 0.5f}));
  EXPECT_TRUE(has(check_mesh(cubes, kWatertight), "part-intersections"));
  const Mesh wrapped = wrap(cubes, {0.05, 0.002});
  const MeshFigures after = check_mesh(wrapped, kWatertight);
  EXPECT_EQ(after.verdict, "sound; closed, 1 part");
  // The union has 2 − 1/8; the wrap stands off by 0.002 of the diagonal of 2.6 on an area of 10.5, and bridges the
  // notches between the cubes by balls of 0.13.
  EXPECT_GT(after.volume, 1.875);
  EXPECT_LT(after.volume, 2.1);
}

TEST(Wrap, ClosesASheetAndASoup) {
  const MeshFigures sheet = check_mesh(wrap(test::cloth(4), {0.1, 0.0}), kWatertight);
  EXPECT_EQ(sheet.verdict, "sound; closed, 1 part");
  Mesh soup = test::exploded(test::cube(1.0f));
  soup.faces.resize(11);  // one triangle is missing
  for (std::size_t f = 0; f < soup.faces.size(); f += 2) std::swap(soup.faces[f][0], soup.faces[f][1]);
  EXPECT_TRUE(check_mesh(wrap(soup, {0.9, 0.01}), kWatertight).closed);
}

TEST(Wrap, RefusesAnAbsurdAlphaBeforeItStarts) {
  WrapOptions options{1e-5, 0.0};
  try {
    wrap(test::cube(1.0f), options);
    FAIL() << "accepted";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("are the most"), std::string::npos) << error.what();
  }
  EXPECT_THROW(wrap(test::cube(1.0f), {0.0, 0.0}), InputError);
  EXPECT_THROW(wrap(test::cube(1.0f), {0.1, -1.0}), InputError);
}

TEST(Wrap, TheEstimateIsOfTheRightSize) {
  const Mesh sphere = geometry::icosphere(4, 0.5);
  const WrapOptions options{0.015, 0.001};
  const auto estimated = static_cast<double>(estimated_wrap_faces(sphere, options));
  const auto made = static_cast<double>(wrap(sphere, options).faces.size());
  EXPECT_LT(std::abs(std::log(made / estimated)), std::log(2.0)) << made << " against " << estimated;
}

TEST(Remesh, KeepsShapeAndHitsTheEdgeLength) {
  const Mesh cube = test::cube(1.0f);
  RemeshOptions options;
  options.edge_length = 0.1;
  const Remeshed remeshed = remesh(cube, options);
  const MeshFigures after = check_mesh(remeshed.mesh, kWatertight);
  EXPECT_EQ(after.verdict, "sound; closed, 1 part");
  EXPECT_EQ(remeshed.sharp_edges, 12u);
  // Sharp edges and corners stay, so the cube stays one, up to the rounding of positions.
  EXPECT_NEAR(after.volume, 1.0, 1e-5);
  EXPECT_NEAR(after.area, 6.0, 1e-4);
  EXPECT_NEAR(after.mean_edge, 0.1, 0.02);
}

TEST(Remesh, ASphereKeepsItsVolume) {
  const Mesh sphere = geometry::icosphere(4, 0.5);
  const double before = test::enclosed_volume(sphere);
  RemeshOptions options;
  // A little longer edges take this regular mesh from 4,900 to 3,100 faces.
  for (const std::size_t faces : {1500U, 3000U}) {
    options.faces = faces;
    const Remeshed remeshed = remesh(sphere, options);
    EXPECT_NEAR(static_cast<double>(remeshed.mesh.faces.size()) / static_cast<double>(faces), 1.0, 0.05);
    // Chords of length 0.04 on a radius of 0.5 lose three thousandths of the volume, and smoothing as much.
    EXPECT_NEAR(test::enclosed_volume(remeshed.mesh), before, 0.01 * before);
  }
}

TEST(Remesh, AClothKeepsItsCornersAndBorder) {
  RemeshOptions options;
  options.edge_length = 0.07;
  const Mesh made = remesh(test::cloth(3), options).mesh;
  const MeshFigures after = check_mesh(made);
  EXPECT_NEAR(after.area, 1.0, 1e-5);
  EXPECT_EQ(after.borders, 1u);
  EXPECT_EQ(after.box.high, Eigen::Vector3d(1, 1, 0));
}

TEST(Remesh, BodiesStayApartAndASoupIsMadeAManifoldFirst) {
  const Mesh two = test::together(test::exploded(test::cube(1.0f)), test::cube(1.0f, {3, 0, 0}));
  RemeshOptions options;
  options.edge_length = 0.25;
  const MeshFigures after = check_mesh(remesh(two, options).mesh, kWatertight);
  EXPECT_EQ(after.verdict, "sound; closed, 2 parts");
}

TEST(Remesh, RefusesWhatCannotBe) {
  RemeshOptions options;
  options.edge_length = 1e-5;
  EXPECT_THROW(remesh(test::cube(1.0f), options), InputError);
  options.edge_length = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(remesh(test::cube(1.0f), options), InputError);
  Mesh line = test::cloth(1);
  line.faces = {{0, 0, 1}};
  EXPECT_THROW(remesh(line, {}), InputError);
}

TEST(RunLimited, GivesResultsErrorsAndLimits) {
  const auto cube = [](const StepReport& report) {
    report(1, 2);
    return MeshResult{test::cube(1.0f), {4, 5}, {{"faces", 12}}};
  };
  const MeshResult result = run_limited("testing", cube, {});
  EXPECT_EQ(result.mesh.faces, test::cube(1.0f).faces);
  EXPECT_EQ(result.mesh.vertices, test::cube(1.0f).vertices);
  EXPECT_EQ(result.place, (std::vector<std::int32_t>{4, 5}));
  EXPECT_EQ(result.figures.at("faces"), 12);
  const auto refuses = [](const StepReport&) -> MeshResult { throw InputError("a.glb", "alpha", "is absurd"); };
  try {
    run_limited("testing", refuses, {});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_EQ(error.file(), "a.glb");
    EXPECT_EQ(error.place(), "alpha");
    EXPECT_EQ(error.problem(), "is absurd");
  }
  const auto fails = [](const StepReport&) -> MeshResult { throw Error("gave up"); };
  EXPECT_THROW(run_limited("testing", fails, {}), Error);
  const auto spins = [](const StepReport& report) -> MeshResult {
    for (std::size_t i = 0;; ++i) report(i % 2, 2);
  };
  EXPECT_THROW(run_limited("testing", spins, {1.0, 0}), Error);
}

}  // namespace
}  // namespace anigen::mesh_health
