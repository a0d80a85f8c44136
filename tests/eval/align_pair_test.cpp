#include "anigen/eval/align/alignment.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "tests/eval/align_shapes.h"

namespace anigen::eval {
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
}  // namespace anigen::eval
