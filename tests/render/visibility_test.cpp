#include "anigen/render/visibility.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/primitives.h"
#include "anigen/render/cameras_json.h"
#include "anigen/render/dataset_views.h"
#include "tests/geometry/mesh_shape.h"

namespace anigen::render {
namespace {

using geometry::icosphere;

VisibilityViews few_views() {
  VisibilityViews options;
  options.views = 64;
  options.size = 256;
  return options;
}

HiddenFaceRemoval removal() {
  HiddenFaceRemoval options;
  options.views = few_views();
  return options;
}

/// A round pot with a wall: the surface of revolution of an outer arc from the south pole to the mouth and an inner arc
/// back down. @param mouth angle between the axis and the rim, radians
Mesh pot(double mouth, int sections = 24) {
  constexpr double kOuter = 0.5, kInner = 0.44, kPi = 3.14159265358979323846;
  constexpr int kRings = 24;
  Mesh mesh;
  mesh.vertices = {{0, 0, -0.5f}, {0, 0, -0.44f}};
  const auto add_ring = [&](double radius, double polar) {
    for (int s = 0; s < sections; ++s) {
      const double around = 2 * kPi * s / sections;
      mesh.vertices.push_back((radius * Eigen::Vector3d(std::sin(polar) * std::cos(around),
                                                        std::sin(polar) * std::sin(around), std::cos(polar)))
                                  .cast<float>());
    }
  };
  for (int r = 0; r < kRings; ++r) add_ring(kOuter, kPi - (kPi - mouth) * (r + 1) / kRings);
  for (int r = kRings - 1; r >= 0; --r) add_ring(kInner, kPi - (kPi - mouth) * (r + 1) / kRings);
  const auto at = [&](int ring, int s) { return 2 + ring * sections + s % sections; };
  for (int s = 0; s < sections; ++s) {
    mesh.faces.push_back({0, at(0, s + 1), at(0, s)});
    mesh.faces.push_back({1, at(2 * kRings - 1, s), at(2 * kRings - 1, s + 1)});
    for (int r = 0; r + 1 < 2 * kRings; ++r) {
      mesh.faces.push_back({at(r, s), at(r, s + 1), at(r + 1, s + 1)});
      mesh.faces.push_back({at(r, s), at(r + 1, s + 1), at(r + 1, s)});
    }
  }
  return mesh;
}

// The published view of the same number, taken by rays in place of the depth buffer.
TEST(FaceVisibility, CountsTheFacesThatPicturesShow) {
  Asset asset;
  asset.mesh = test::together(icosphere(2, 0.4), icosphere(1, 0.1));
  for (std::size_t v = 162; v < asset.mesh.vertices.size(); ++v) asset.mesh.vertices[v].x() += 0.45f;  // half inside
  VisibilityViews options = few_views();
  options.views = 9;
  options.size = 64;
  const Scene scene(asset);
  const ViewRenderer renderer(scene);
  ViewOptions picture;
  picture.size = options.size;
  picture.color = false;
  picture.visibility = true;
  std::vector<int> seen(asset.mesh.faces.size(), 0);
  for (std::size_t i = 0; i < options.views; ++i) {
    ViewCamera view = hammersley_view(i, options.views, 0.0, 0.0, false);
    view.yaw = 0.5 * 3.14159265358979323846 - view.yaw;
    Frame frame;
    frame.camera_angle_x = view.fov = kFeatureFov;
    view.radius = kFeatureRadius;
    frame.camera_to_world = camera_to_world(view);
    std::vector<char> in_picture(seen.size(), 0);
    for (const std::int32_t face : renderer.render(frame, picture).face) {
      if (face >= 0) in_picture[static_cast<std::size_t>(face)] = 1;
    }
    for (std::size_t f = 0; f < seen.size(); ++f) seen[f] += in_picture[f];
  }
  const std::vector<float> visibility = face_visibility(asset.mesh, options);
  std::size_t different = 0;
  for (std::size_t f = 0; f < seen.size(); ++f)
    different += std::abs(visibility[f] - static_cast<float>(seen[f]) / 9.0f) > 1e-6f;
  // Rays run in single precision: a face that shows in one pixel on its edge may be missed.
  EXPECT_LE(different, 4u);
  EXPECT_GT(*std::max_element(visibility.begin(), visibility.end()), 0.4f);
  EXPECT_GT(std::count(visibility.begin(), visibility.end(), 0.0f), 5);  // of the small sphere's hidden half
}

TEST(FaceVisibility, HasNoGapsBetweenFaces) {
  // Not one ray may slip through the outer sphere, whose 20,480 faces are about as small as the pixels.
  const Mesh mesh = test::together(icosphere(5, 0.5), icosphere(2, 0.45));
  const std::vector<float> visibility = face_visibility(mesh, few_views());
  EXPECT_EQ(std::count(visibility.begin() + 20480, visibility.end(), 0.0f), 320);
}

TEST(FaceVisibility, DoesNotDependOnThreadsAndReportsProgress) {
  VisibilityViews options = few_views();
  options.views = 12;
  std::size_t calls = 0, last = 0;
  options.progress = [&](std::size_t done) { calls += done == last + 1, last = done; };
  const Mesh mesh = icosphere(3, 0.5);
  set_thread_count(1);
  const std::vector<float> alone = face_visibility(mesh, options);
  EXPECT_EQ(calls, 12u);
  set_thread_count(0);
  options.progress = nullptr;
  EXPECT_EQ(face_visibility(mesh, options), alone);
}

TEST(FaceVisibility, RefusesWhatItCannotDraw) {
  VisibilityViews options;
  options.views = 0;
  EXPECT_THROW(face_visibility(icosphere(0, 0.5), options), InputError);
  options = {};
  options.size = 0;
  EXPECT_THROW(face_visibility(icosphere(0, 0.5), options), InputError);
  Mesh broken = icosphere(0, 0.5);
  broken.faces[0][0] = 12;
  EXPECT_THROW(face_visibility(broken), InputError);
}

TEST(RemoveHiddenFaces, TakesAwayASphereInsideASphere) {
  const Mesh outer = icosphere(3, 0.5);
  const VisibleMesh result = remove_hidden_faces(test::together(outer, icosphere(2, 0.3)), removal());
  EXPECT_EQ(result.removed, 320u);
  EXPECT_EQ(result.mesh.faces, outer.faces);
  EXPECT_EQ(result.mesh.vertices, outer.vertices);
}

TEST(RemoveHiddenFaces, KeepsBothSidesOfAThinPlate) {
  Mesh plate = icosphere(3, 0.5);
  for (Eigen::Vector3f& vertex : plate.vertices) vertex.z() *= 0.02f;
  plate.colors.assign(plate.vertices.size(), Eigen::Vector4f::Ones());
  const VisibleMesh result = remove_hidden_faces(plate, removal());
  EXPECT_EQ(result.removed, 0u);
  EXPECT_EQ(result.mesh.faces, plate.faces);
  EXPECT_EQ(result.mesh.colors.size(), plate.colors.size());
}

TEST(RemoveHiddenFaces, ClosesAPotWithANarrowMouthAndLeavesAWideOne) {
  // Mouths of radius 0.04 and 0.25: the area of the hole that taking the inside away would leave is below and above
  // 0.04.
  const Mesh narrow = pot(0.08);
  ASSERT_TRUE(test::edge_census(narrow.faces).is_closed());
  const VisibleMesh closed = remove_hidden_faces(narrow, removal());
  EXPECT_GT(closed.removed, narrow.faces.size() / 3);
  EXPECT_EQ(closed.filled_holes, 1u);
  EXPECT_EQ(closed.open_holes, 0u);
  EXPECT_TRUE(test::edge_census(closed.mesh.faces).is_closed());
  EXPECT_NEAR(test::enclosed_volume(closed.mesh), 3.14159265 / 6.0, 0.02);  // solid now
  const Mesh wide = pot(0.52);
  EXPECT_EQ(remove_hidden_faces(wide, removal()).removed, 0u);
}

}  // namespace
}  // namespace anigen::render
