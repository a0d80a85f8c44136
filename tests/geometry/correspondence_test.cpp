#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <cmath>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/geometry/correspondence.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/primitives.h"
#include "anigen/geometry/sampling.h"
#include "anigen/geometry/simplify.h"
#include "tests/metrics/align_shapes.h"

namespace anigen::geometry {

namespace {

using Eigen::Vector3f;

/// Adds an axis-aligned box whose faces look outwards, or inwards, and share their vertices.
void add_box(Mesh& mesh, const Vector3f& low, const Vector3f& high, bool inwards = false) {
  const auto first = static_cast<std::int32_t>(mesh.vertices.size());
  for (int i = 0; i < 8; ++i) {
    mesh.vertices.emplace_back((i & 1) != 0 ? high.x() : low.x(), (i & 2) != 0 ? high.y() : low.y(),
                               (i & 4) != 0 ? high.z() : low.z());
  }
  for (Triangle face : {Triangle{0, 2, 1},
                        {1, 2, 3},
                        {4, 5, 6},
                        {5, 7, 6},
                        {0, 1, 4},
                        {1, 5, 4},
                        {2, 6, 3},
                        {3, 6, 7},
                        {0, 4, 2},
                        {2, 4, 6},
                        {1, 3, 5},
                        {3, 7, 5}}) {
    if (inwards) std::swap(face[1], face[2]);
    for (std::int32_t& corner : face) corner += first;
    mesh.faces.push_back(face);
  }
}

/// One joint per block of 8 vertices.
SkinWeights skin_by_box(const Mesh& mesh) {
  SkinWeights skin;
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) skin.append_row({{static_cast<std::int32_t>(v / 8), 1.0f}});
  return skin;
}

/// Vertices of `to` whose weights on the mesh are not those of the box they came from.
std::size_t mistaken(const Mesh& mesh, const Mesh& to) {
  const SkinWeights moved = transfer_skin_to_mesh(mesh, skin_by_box(mesh), to);
  std::size_t count = 0;
  for (std::size_t v = 0; v < to.vertices.size(); ++v)
    count += moved.row_size(v) != 1 || moved.row(v)[0].joint != static_cast<std::int32_t>(v / 8) ? 1 : 0;
  return count;
}

std::vector<Eigen::Vector3d> points_of(const Mesh& mesh) {
  std::vector<Eigen::Vector3d> points;
  for (const Vector3f& vertex : mesh.vertices) points.push_back(vertex.cast<double>());
  return points;
}

/// Turned, with the rounding of single precision everywhere.
Mesh moved_away_and_back(Mesh mesh) {
  const Eigen::Matrix3f turn = Eigen::AngleAxisf(0.7f, Vector3f(1, 2, 3).normalized()).toRotationMatrix();
  const Vector3f offset(0.3f, -0.2f, 0.1f);
  for (Vector3f& vertex : mesh.vertices) {
    const Vector3f there = turn * vertex + offset;
    vertex = turn.transpose() * (there - offset);
  }
  return mesh;
}

TEST(MatchingPlaces, PartsThatTouchKeepTheirOwnWeights) {
  Mesh mesh;
  add_box(mesh, {0, 0, 0}, {1, 1, 1});
  add_box(mesh, {1, 0, 0}, {2, 1, 1});                // shares a side, seen from the other side
  add_box(mesh, {0, 0, 1}, {0.5f, 0.5f, 1.5f});       // stands on the first with a corner above a corner
  add_box(mesh, {0.5f, 0.5f, 0.25f}, {1, 1, 0.75f});  // inside the first, at its side
  EXPECT_EQ(mistaken(mesh, mesh), 0u);
  EXPECT_EQ(mistaken(moved_away_and_back(mesh), mesh), 0u);
  // The test has something to find: the plain nearest place is mistaken.
  const SkinWeights plain = transfer_skin(mesh, skin_by_box(mesh), points_of(mesh));
  std::size_t wrong = 0;
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) wrong += plain.row(v)[0].joint != static_cast<int>(v / 8);
  EXPECT_GT(wrong, 4u);
}

TEST(MatchingPlaces, TwoSidesOfOneSheetDifferByTheWayTheyFace) {
  Mesh mesh;
  add_box(mesh, {0, 0, 0}, {1, 1, 1}, true);
  add_box(mesh, {0, 0, 0}, {1, 1, 1});
  EXPECT_EQ(mistaken(mesh, mesh), 0u);
  EXPECT_EQ(mistaken(moved_away_and_back(mesh), mesh), 0u);
}

TEST(MatchingPlaces, WholeCopiesAreTakenInOrder) {
  Mesh mesh;
  for (int i = 0; i < 3; ++i) add_box(mesh, {0, 0, 0}, {1, 1, 1});
  EXPECT_EQ(mistaken(mesh, mesh), 0u);
}

TEST(MatchingPlaces, SeamsDoNotChangeTheShape) {
  // One box twice: closed, and split along an edge as texture seams do; beside it a box that touches at a side.
  Mesh closed;
  add_box(closed, {0, 0, 0}, {1, 1, 1});
  add_box(closed, {1, 0, 0}, {2, 1, 1});
  Mesh split = closed;
  for (const std::int32_t vertex : {1, 3, 5, 7}) {  // the side that touches
    const auto copy = static_cast<std::int32_t>(split.vertices.size());
    split.vertices.push_back(split.vertices[static_cast<std::size_t>(vertex)]);
    for (const std::size_t face : {10u, 11u}) {
      for (std::int32_t& corner : split.faces[face]) corner = corner == vertex ? copy : corner;
    }
  }
  SkinWeights split_skin = skin_by_box(closed);
  for (int i = 0; i < 4; ++i) split_skin.append_row({{0, 1.0f}});
  const SkinWeights from_split = transfer_skin_to_mesh(split, split_skin, closed);
  const SkinWeights to_split = transfer_skin_to_mesh(closed, skin_by_box(closed), split);
  for (std::size_t v = 0; v < split.vertices.size(); ++v) {
    const std::int32_t joint = v >= 8 && v < 16 ? 1 : 0;
    EXPECT_EQ(to_split.row(v)[0].joint, joint) << v;
    if (v < closed.vertices.size()) {
      EXPECT_EQ(from_split.row(v)[0].joint, joint) << v;
    }
  }
}

TEST(MatchingPlaces, IsTheNearestPlaceWhereNothingCoincides) {
  const Mesh mesh = test::walker(7);
  Mesh other = test::walker(5);
  Rng rng(4, "matching places");
  for (Vector3f& vertex : other.vertices) {
    for (float& x : vertex.reshaped()) x += static_cast<float>(rng.uniform(-0.02, 0.02));
  }
  const NearestSurface surface(mesh);
  const auto places = matching_places(mesh, other);
  ASSERT_EQ(places.size(), other.vertices.size());
  for (std::size_t v = 0; v < places.size(); ++v) {
    const Eigen::Vector3d vertex = other.vertices[v].cast<double>();
    const Eigen::Vector3d at = position(places[v], mesh.vertices, mesh.faces);
    EXPECT_NEAR((at - vertex).norm(), surface.query(vertex).distance, 2e-6);
  }
}

TEST(MatchingPlaces, NeedsNoFacesAroundTheVertices) {
  Mesh mesh, points;
  add_box(mesh, {0, 0, 0}, {1, 1, 1});
  points.vertices = mesh.vertices;
  EXPECT_EQ(mistaken(mesh, points), 0u);
  EXPECT_TRUE(matching_places(mesh, Mesh{}).empty());
}

TEST(MatchingPlaces, RefusesBadInput) {
  Mesh mesh;
  add_box(mesh, {0, 0, 0}, {1, 1, 1});
  EXPECT_THROW(matching_places(Mesh{}, mesh), InputError);
  Mesh bad = mesh;
  bad.vertices[2].y() = NAN;
  EXPECT_THROW(matching_places(mesh, bad), InputError);
  EXPECT_THROW(matching_places(bad, mesh), InputError);
  bad = mesh;
  bad.faces[3][1] = 99;
  EXPECT_THROW(matching_places(mesh, bad), InputError);
  EXPECT_THROW(matching_places(bad, mesh), InputError);
  EXPECT_THROW(transfer_skin_to_mesh(mesh, SkinWeights{}, mesh), InputError);
}

}  // namespace

namespace {

/// Weights of three joints that are linear in the position along the longest axis, so that interpolation is exact.
std::vector<float> weights_at(const Eigen::Vector3d& p) {
  const auto w = static_cast<float>(std::min(1.0, std::max(0.0, 0.5 + 0.5 * p.z())));
  return {0.25f, 0.75f * w, 0.75f * (1.0f - w)};
}

SkinWeights linear_skin(const std::vector<Eigen::Vector3f>& vertices) {
  std::vector<float> dense;
  for (const Eigen::Vector3f& vertex : vertices) {
    for (const float weight : weights_at(vertex.cast<double>())) dense.push_back(weight);
  }
  return from_dense(dense, vertices.size(), 3);
}

double largest_error(const SkinWeights& skin, const std::vector<Eigen::Vector3d>& points) {
  const std::vector<float> dense = to_dense(skin, 3);
  double largest = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::vector<float> truth = weights_at(points[i]);
    for (std::size_t j = 0; j < 3; ++j) largest = std::max(largest, double{std::abs(dense[3 * i + j] - truth[j])});
  }
  return largest;
}

TEST(SkinTransfer, ToItsOwnVerticesChangesNothing) {
  const Mesh mesh = test::walker(7);
  const SkinWeights skin = linear_skin(mesh.vertices);
  std::vector<Eigen::Vector3d> points;
  for (const Eigen::Vector3f& vertex : mesh.vertices) points.push_back(vertex.cast<double>());
  EXPECT_LT(largest_error(transfer_skin(mesh, skin, points), points), 1e-6);
  EXPECT_LT(largest_error(transfer_skin_by_vertex(points, skin, points), points), 1e-6);
}

TEST(SkinTransfer, IsExactForLinearWeightsWhereTheNearestVertexIsNot) {
  const Mesh mesh = test::walker(7);
  const SkinWeights skin = linear_skin(mesh.vertices);
  Rng rng(1, "points");
  std::vector<Eigen::Vector3d> points, vertices;
  for (const auto& at : sample_surface(mesh.vertices, mesh.faces, 500, rng))
    points.push_back(position(at, mesh.vertices, mesh.faces));
  for (const Eigen::Vector3f& vertex : mesh.vertices) vertices.push_back(vertex.cast<double>());
  const SkinWeights moved = transfer_skin(mesh, skin, points);
  ASSERT_EQ(moved.rows(), points.size());
  EXPECT_LT(largest_error(moved, points), 1e-5);
  EXPECT_GT(largest_error(transfer_skin_by_vertex(vertices, skin, points), points), 1e-2);
}

TEST(SkinTransfer, RefusesBadInput) {
  const Mesh mesh = test::walker(4);
  const SkinWeights skin = linear_skin(mesh.vertices);
  EXPECT_THROW(transfer_skin(Mesh{}, SkinWeights{}, {{0, 0, 0}}), InputError);
  EXPECT_THROW(transfer_skin(mesh, SkinWeights{}, {{0, 0, 0}}), InputError);
  EXPECT_THROW(transfer_skin(mesh, skin, {{NAN, 0, 0}}), InputError);
  EXPECT_THROW(transfer_skin_by_vertex({}, SkinWeights{}, {{0, 0, 0}}), InputError);
  EXPECT_THROW(transfer_skin_by_vertex({{0, 0, 0}}, SkinWeights{}, {{0, 0, 0}}), InputError);
  EXPECT_EQ(transfer_skin(mesh, skin, {}).rows(), 0u);
}

}  // namespace

namespace {

/// A square in two triangles, bound to four joints, one per corner.
Mesh square() {
  Mesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  mesh.faces = {{0, 1, 2}, {0, 2, 3}};
  mesh.colors = {{1, 0, 0, 1}, {0, 1, 0, 1}, {0, 0, 1, 1}, {0, 0, 0, 0}};
  return mesh;
}

SkinWeights corners() {
  SkinWeights skin;
  for (std::int32_t j = 0; j < 4; ++j) skin.append_row({{j, 1.0f}});
  return skin;
}

TEST(TransferAttributes, InterpolatesAtTheNearestPlace) {
  const auto result = transfer_attributes(square(), corners(), {{0.5f, 0.25f, 3.0f}, {2.0f, 2.0f, 0.0f}, {0, 1, -1}});
  const std::vector<float> expected{.5f, .25f, .25f, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  const std::vector<float> dense = to_dense(result.skin, 4);
  ASSERT_EQ(dense.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(dense[i], expected[i], 1e-6);
  ASSERT_EQ(result.colors.size(), 3u);
  EXPECT_LT((result.colors[0] - Eigen::Vector4f(0.5f, 0.25f, 0.25f, 1.0f)).norm(), 1e-6f);
  EXPECT_EQ(result.colors[2], Eigen::Vector4f(0, 0, 0, 0));
}

TEST(TransferAttributes, GivesASimplifiedMeshTheWeightsOfTheOriginal) {
  const Mesh sphere = icosphere(4, 0.5);
  SkinWeights skin;  // weight of joint 1 rises from the south pole to the north pole
  for (const Eigen::Vector3f& vertex : sphere.vertices)
    skin.append_row({{0, 0.5f - vertex.z()}, {1, 0.5f + vertex.z()}});
  const Mesh simple = simplify(sphere.vertices, sphere.faces, 256).mesh;
  const auto result = transfer_attributes(sphere, skin, simple.vertices);
  ASSERT_EQ(result.skin.rows(), simple.vertices.size());
  EXPECT_TRUE(result.colors.empty());
  const std::vector<float> dense = to_dense(result.skin, 2);
  for (std::size_t v = 0; v < simple.vertices.size(); ++v) {
    // Simplified vertices lie within 0.01 of the surface, whose weights change by 1 per unit.
    EXPECT_NEAR(dense[2 * v + 1], 0.5f + simple.vertices[v].z(), 0.01);
  }
}

TEST(TransferAttributes, RefusesArraysOfAnotherLength) {
  SkinWeights short_skin;
  short_skin.append_row({{0, 1.0f}});
  EXPECT_THROW(transfer_attributes(square(), short_skin, {}), InputError);
  Mesh mesh = square();
  mesh.colors.pop_back();
  EXPECT_THROW(transfer_attributes(mesh, corners(), {}), InputError);
  mesh = square();
  mesh.faces.clear();
  EXPECT_THROW(transfer_attributes(mesh, corners(), {}), InputError);
  EXPECT_EQ(transfer_attributes(square(), SkinWeights(), {{0, 0, 0}}).skin.rows(), 0u);
}

}  // namespace

}  // namespace anigen::geometry
