#include <gtest/gtest.h>
#include <cmath>
#include <filesystem>

#include "anigen/core/error.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/metrics/alignment.h"
#include "anigen/metrics/surface.h"
#include "tests/metrics/align_shapes.h"
#include "tests/support/paths.h"

// Real assets, moved and turned, come back onto themselves.

namespace anigen::metrics {

namespace {

TEST(AlignAssets, JointsComeBackAfterARandomSimilarity) {
  const std::filesystem::path folder = test::assets_dir() / "rigged";
  if (!std::filesystem::exists(folder)) {
    GTEST_SKIP() << folder << " is missing";
  }
  std::uint64_t seed = 0;
  for (const char* name :
       {"humanoid/cesium_man.gltf", "humanoid/kaykit_knight.glb", "quadruped/khronos_fox.glb", "quadruped/q_stag.glb",
        "reptile_dragon/q_trex.glb", "fish/q_goldfish.glb", "hand/aframe_left_hand_high.glb"}) {
    if (!std::filesystem::exists(folder / name)) {
      GTEST_SKIP() << name << " is missing";
    }
    const io::RiggedShape truth = io::rigged_shape(io::read_gltf(folder / name).asset, name, name);
    // Around its own place: single precision vertices lose digits far from the origin.
    const Similarity unit = normalization(truth.mesh, NormalizationMode::kBoundingBox);
    const io::RiggedShape prediction = transformed(compose(test::random_similarity(++seed), unit), truth);
    const Alignment alignment = align(prediction, truth);
    for (std::size_t j = 0; j < truth.joints.size(); ++j) {
      // Also for joints far outside the mesh: well below the 1e-3 that scores may be off by.
      const Eigen::Vector3d there = alignment.truth(truth.joints.positions[j]);
      EXPECT_LT((alignment.prediction(prediction.joints.positions[j]) - there).norm(), 2e-5 * (1 + there.norm()))
          << name << ", joint " << j;
    }
  }
}

}  // namespace

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
    // One shape up to the rotation that is still to be found.
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

namespace {

AlignmentOptions light_alignment() {
  AlignmentOptions options;
  options.registration.rotations = 30;
  options.registration.samples = 600;
  options.registration.score_samples = 1000;
  return options;
}

double joint_distance(const Alignment& alignment, const io::RiggedShape& prediction, const io::RiggedShape& truth) {
  double largest = 0.0;
  for (std::size_t j = 0; j < truth.joints.size(); ++j) {
    largest = std::max(
        largest,
        (alignment.prediction(prediction.joints.positions[j]) - alignment.truth(truth.joints.positions[j])).norm());
  }
  return largest;
}

TEST(Align, UndoesRotationScaleAndTranslationOfMeshAndJoints) {
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    const io::RiggedShape truth = test::rigged(seed % 2 == 0 ? test::walker(9) : test::crawler(9));
    const io::RiggedShape prediction = transformed(test::random_similarity(seed), truth);
    const Alignment alignment = align(prediction, truth, light_alignment());
    EXPECT_EQ(alignment.by, AlignedBy::kSurface);
    EXPECT_TRUE(alignment.icp_used);
    // Vertices in single precision, off centre by up to 3 of their size: a few 1e-6 of the box remain.
    EXPECT_LT(joint_distance(alignment, prediction, truth), 5e-6);
    EXPECT_LT(test::largest_offset(alignment.prediction, prediction.mesh, alignment.truth, truth.mesh), 5e-6);
    EXPECT_LT(alignment.icp.rmse, 2e-6);
  }
}

TEST(Align, TruthComesIntoTheUnitBoxWhateverIcpRanOn) {
  const io::RiggedShape truth = transformed(test::random_similarity(5), test::rigged(test::walker(8)));
  for (const NormalizationMode mode : {NormalizationMode::kCentroidRms, NormalizationMode::kBoundingBox}) {
    AlignmentOptions options = light_alignment();
    options.normalization = mode;
    const Alignment alignment = align(truth, truth, options);
    const Box box = bounding_box(transformed(alignment.truth, truth.mesh).vertices);
    EXPECT_NEAR(box.longest_side(), 1.0, 1e-6);
    EXPECT_LT(box.center().norm(), 1e-6);
    EXPECT_LT(joint_distance(alignment, truth, truth), 1e-6);
  }
}

TEST(Align, WithoutIcpNormalisationIsAll) {
  const io::RiggedShape truth = test::rigged(test::walker(8));
  Similarity shift = test::random_similarity(6);
  shift.rotation.setIdentity();
  const io::RiggedShape prediction = transformed(shift, truth);
  AlignmentOptions options = light_alignment();
  options.icp = false;
  options.normalization = NormalizationMode::kBoundingBox;
  const Alignment alignment = align(prediction, truth, options);
  EXPECT_FALSE(alignment.icp_used);
  EXPECT_LT(joint_distance(alignment, prediction, truth), 1e-6);
  EXPECT_TRUE(alignment.prediction.rotation.isIdentity(0.0));
  // Untouched coordinates.
  options.normalization = NormalizationMode::kNone;
  const Alignment raw = align(prediction, truth, options);
  EXPECT_TRUE(raw.prediction.matrix().isIdentity(0.0));
  EXPECT_TRUE(raw.truth.matrix().isIdentity(0.0));
}

TEST(Align, ResidualIsInTheFrameOfScores) {
  const io::RiggedShape truth = test::rigged(test::walker(8));
  io::RiggedShape fat = truth;
  for (Eigen::Vector3f& vertex : fat.mesh.vertices) vertex.x() *= 1.15f;
  const double rmse = align(fat, truth, light_alignment()).icp.rmse;
  Similarity large;
  large.scale = 100.0;
  EXPECT_NEAR(align(transformed(large, fat), transformed(large, truth), light_alignment()).icp.rmse, rmse, 1e-4 * rmse);
}

TEST(Align, ShapesWithoutASurfaceUseVerticesOrJoints) {
  const io::RiggedShape truth = test::rigged(test::walker(9));
  const Similarity moved_by = test::random_similarity(7);
  io::RiggedShape points = transformed(moved_by, truth);
  points.mesh.faces.clear();
  EXPECT_EQ(align(points, truth, light_alignment()).by, AlignedBy::kVertices);
  // Four joints in general position determine the motion.
  io::RiggedShape bones;
  bones.joints = {{{0, 0, 0}, {0, 0, 0.5}, {0.3, 0, 0.4}, {0.1, 0.2, 0.9}}, {-1, 0, 1, 1}};
  const io::RiggedShape moved = transformed(moved_by, bones);
  const Alignment alignment = align(moved, bones, light_alignment());
  EXPECT_EQ(alignment.by, AlignedBy::kJoints);
  EXPECT_LT(joint_distance(alignment, moved, bones), 1e-9);
  EXPECT_EQ(to_string(alignment.by), "joints");
}

TEST(Align, TheUnitIsTheTruthsMeshAlsoWhereJointsAreRegistered) {
  const io::RiggedShape truth = test::rigged(test::walker(9));
  io::RiggedShape bones = truth;
  bones.mesh = {};
  bones.skin = {};
  const Alignment of_mesh = align(truth, truth, light_alignment()), of_joints = align(bones, truth, light_alignment());
  EXPECT_EQ(of_joints.by, AlignedBy::kJoints);
  EXPECT_NEAR(of_joints.truth.scale, of_mesh.truth.scale, 1e-12);
  EXPECT_LT(joint_distance(of_joints, bones, truth), 1e-6);
}

TEST(Align, BadShapesAreNamed) {
  io::RiggedShape truth = test::rigged(test::walker(5)), nothing;
  nothing.file = "empty.glb";
  try {
    align(nothing, truth, light_alignment());
    FAIL() << "a shape without anything was aligned";
  } catch (const InputError& error) {
    EXPECT_EQ(error.file(), "empty.glb");
  }
  io::RiggedShape broken = truth;
  broken.file = "broken.glb";
  broken.mesh.vertices[2].y() = NAN;
  try {
    align(truth, broken, light_alignment());
    FAIL() << "a NaN was accepted";
  } catch (const InputError& error) {
    EXPECT_EQ(error.file(), "broken.glb");
  }
  AlignmentOptions options = light_alignment();
  options.registration.trim = 2.0;
  EXPECT_THROW(align(truth, truth, options), InputError);
  io::RiggedShape dot;  // one joint: no size, no direction
  dot.joints = {{{1, 2, 3}}, {-1}};
  const Alignment alignment = align(dot, dot, light_alignment());
  EXPECT_LT(joint_distance(alignment, dot, dot), 1e-12);
}

}  // namespace

}  // namespace anigen::metrics
