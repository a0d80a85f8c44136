#include "anigen/geometry/inside.h"

#include <gtest/gtest.h>

#include <limits>

#include "anigen/core/random.h"

namespace anigen::geometry {
namespace {

using Vector = Eigen::Vector3d;

struct Shell {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Triangle> faces;

  void add(const Mesh& part, const Eigen::Vector3f& at, bool turned = false) {
    const auto base = static_cast<std::int32_t>(vertices.size());
    for (const Eigen::Vector3f& v : part.vertices) vertices.push_back(v + at);
    for (Triangle face : part.faces) {
      for (std::int32_t& corner : face) corner += base;
      if (turned) std::swap(face[0], face[1]);
      faces.push_back(face);
    }
  }
  std::vector<bool> inside(const std::vector<Vector>& points, double margin = 0.0) const {
    return InsideTest(vertices, faces).inside(points, margin);
  }
};

Mesh cube() {  // from -1 to 1
  Mesh mesh;
  for (int i = 0; i < 8; ++i)
    mesh.vertices.emplace_back(i & 1 ? 1.0F : -1.0F, i & 2 ? 1.0F : -1.0F, i & 4 ? 1.0F : -1.0F);
  mesh.faces = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return mesh;
}

TEST(InsideTest, CubeByHand) {
  Shell shell;
  shell.add(cube(), {0, 0, 0});
  const InsideTest test(shell.vertices, shell.faces);
  EXPECT_NEAR(test.winding_number({0.3, -0.2, 0.9}), 1.0, 1e-12);
  EXPECT_NEAR(test.winding_number({1.3, -0.2, 0.9}), 0.0, 1e-12);
  Rng rng(1, "points about a cube");
  std::vector<Vector> points;
  for (int i = 0; i < 2000; ++i) points.emplace_back(rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(-2, 2));
  const std::vector<bool> found = test.inside(points);
  for (std::size_t i = 0; i < points.size(); ++i) EXPECT_EQ(found[i], points[i].cwiseAbs().maxCoeff() < 1.0);
}

TEST(InsideTest, OverlapsInvertedPartsAndHolesDoNotMatter) {
  Shell shell;
  shell.add(cube(), {0, 0, 0});
  shell.add(cube(), {1, 0, 0}, /*turned=*/true);  // overlaps the first from 0 to 1, where both together sum to 0
  const std::vector<Vector> points = {{-0.5, 0, 0}, {0.5, 0, 0}, {1.5, 0, 0}, {2.5, 0, 0}, {0, 1.5, 0}};
  EXPECT_EQ(shell.inside(points), (std::vector<bool>{true, true, true, false, false}));

  Shell open;
  Mesh lidless = cube();
  lidless.faces.erase(lidless.faces.begin() + 2, lidless.faces.begin() + 4);  // the top
  open.add(lidless, {0, 0, 0});
  EXPECT_EQ(open.inside({{0, 0, 0}, {0, 0, -0.9}, {0, 0, 1.5}, {1.2, 0, 0}}),
            (std::vector<bool>{true, true, false, false}));

  // In a box around the mesh, not in the mesh: between the ends of a bent body.
  Shell apart;
  apart.add(cube(), {-3, 0, 0});
  apart.add(cube(), {3, 0, 0});
  EXPECT_EQ(apart.inside({{0, 0, 0}, {3, 0, 0}}), (std::vector<bool>{false, true}));
}

TEST(InsideTest, TheMarginCountsTheSurface) {
  Shell sheet;
  sheet.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  sheet.faces = {{0, 1, 2}, {0, 2, 3}};
  const std::vector<Vector> points = {{0.5, 0.5, 1e-4}, {0.5, 0.5, 0.1}, {1.05, 0.5, 0.0}};
  EXPECT_EQ(sheet.inside(points, 1e-3), (std::vector<bool>{true, false, false})) << "a sheet surrounds nothing";
  EXPECT_EQ(sheet.inside(points, 0.06), (std::vector<bool>{true, false, true}));
}

TEST(InsideTest, WhatIsNoMeshOrNoPoint) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(Shell().inside({{0, 0, 0}}), std::vector<bool>{false});
  Shell shell;
  shell.add(cube(), {0, 0, 0});
  shell.vertices.emplace_back(nan, 0.0F, 0.0F);
  shell.faces.push_back({0, 1, 8});
  shell.faces.push_back({0, 1, 900});
  shell.faces.push_back({-1, 1, 2});
  shell.faces.push_back({3, 3, 3});
  EXPECT_EQ(shell.inside({{0, 0, 0}, {0, 0, std::numeric_limits<double>::quiet_NaN()}}),
            (std::vector<bool>{true, false}));
}

}  // namespace
}  // namespace anigen::geometry
