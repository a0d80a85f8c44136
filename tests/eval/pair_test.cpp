#include "anigen/eval/pair.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/eval/metric_table.h"
#include "anigen/geometry/primitives.h"
#include "tests/eval/rigged_walker.h"
#include "tests/eval/study.h"
#include "tests/geometry/mesh_shape.h"

namespace anigen::eval {
namespace {

PairSettings quick() {
  PairSettings settings;
  settings.surface_samples = 2000;
  settings.image_size = 64;
  settings.poses = 3;
  return settings;
}

/// Every metric that is computed by default either has a value or says why not.
void expect_complete(const PairResult& result) {
  for (const MetricInfo& metric : metric_table()) {
    if (metric.group == "soundness") continue;
    EXPECT_EQ(result.values.count(metric.key) + result.not_computed.count(metric.key), 1u) << metric.key;
  }
}

TEST(PairEvaluation, AShapeIsAtNoDistanceFromItself) {
  const io::RiggedShape shape = test::rigged_walker();
  const PairResult result = evaluate_pair(shape, shape, quick());
  expect_complete(result);
  for (const char* key :
       {"j2j", "j2b", "b2b", "wasserstein", "gromov_wasserstein", "fused_gromov_wasserstein", "skin_l1", "skin_l2",
        "deformation_error", "motion_distance", "motion_distance_rest", "surface_chamfer", "rignet.b2b", "unirig.b2b",
        "puppeteer.b2b", "joint_count_error", "tree_edit_distance", "anymate_cd"})
    EXPECT_NEAR(result.value(key), 0.0, 1e-6) << key;
  for (const char* key :
       {"fscore", "normal_consistency", "rignet.iou", "connectivity_precision", "skin_precision", "skin_cos", "ssim"})
    EXPECT_NEAR(result.value(key), 1.0, 1e-5) << key;
  EXPECT_EQ(result.not_computed.count("lpips"), 1u);
}

TEST(PairEvaluation, PlacementOfThePredictionDoesNotMatter) {
  const io::RiggedShape shape = test::rigged_walker();
  for (std::uint64_t seed = 0; seed < 3; ++seed) {
    const PairResult result = evaluate_pair(with_random_placement(shape, seed), shape, quick());
    for (const char* key : {"j2j", "j2b", "b2b", "wasserstein", "gromov_wasserstein", "surface_chamfer"})
      EXPECT_LT(result.value(key), 1e-3) << key << ", placement " << seed;
  }
}

TEST(PairEvaluation, WithoutAlignmentPlacementMatters) {
  PairSettings settings = quick();
  settings.alignment.icp = false;
  settings.groups = {"skeleton", "transport"};
  const io::RiggedShape shape = test::rigged_walker();
  const PairResult result = evaluate_pair(with_random_placement(shape), shape, settings);
  EXPECT_GT(result.value("j2j"), 1e-2);
  // Distances along the skeleton do not change when it is turned; only the scale of normalisation does.
  EXPECT_LT(result.value("gromov_wasserstein"), 1e-3);
  EXPECT_EQ(result.values.count("surface_chamfer"), 0u);
}

TEST(PairEvaluation, FacesInsideABodyDoNotCountWhenOnlyTheVisibleSurfaceDoes) {
  PairSettings settings = quick();
  settings.groups = {"skeleton", "surface"};
  const io::RiggedShape shape = test::rigged_walker();
  io::RiggedShape stuffed = shape;
  Mesh hidden = geometry::icosphere(3, 0.08);
  for (Eigen::Vector3f& vertex : hidden.vertices) vertex += Eigen::Vector3f(0.0f, 0.0f, 0.2f);
  for (int copy = 0; copy < 5; ++copy) stuffed.mesh = test::together(stuffed.mesh, hidden);

  const PairResult all = evaluate_pair(shape, stuffed, settings);
  EXPECT_GT(all.value("surface_chamfer"), 0.01);
  settings.visible_surface = true;
  const PairResult visible = evaluate_pair(shape, stuffed, settings);
  EXPECT_LT(visible.value("surface_chamfer"), 1e-4);
  EXPECT_LT(visible.value("j2j"), 1e-4);
  EXPECT_EQ(to_json(settings).at("visible_surface"), true);

  io::RiggedShape points = shape;
  points.mesh.faces.clear();
  EXPECT_EQ(evaluate_pair(points, stuffed, settings).values.count("j2j"), 1u);
}

TEST(PairEvaluation, MissingPartsLeaveTheRest) {
  const io::RiggedShape truth = test::rigged_walker();
  io::RiggedShape predicted = truth;
  predicted.skin = {};
  PairResult result = evaluate_pair(predicted, truth, quick());
  expect_complete(result);
  EXPECT_EQ(result.not_computed.at("skin_l1"), "the prediction has no skin weights");
  EXPECT_NEAR(result.value("j2j"), 0.0, 1e-6);

  predicted.joints = {};
  result = evaluate_pair(predicted, truth, quick());
  expect_complete(result);
  EXPECT_EQ(result.not_computed.at("j2j"), "the prediction has no skeleton");
  EXPECT_NEAR(result.value("surface_chamfer"), 0.0, 1e-6);

  predicted = truth;
  predicted.mesh = {};
  predicted.skin = {};
  result = evaluate_pair(predicted, truth, quick());
  expect_complete(result);
  EXPECT_EQ(result.not_computed.at("surface_chamfer"), "the prediction has no faces");
  EXPECT_EQ(result.values.count("j2j"), 1u);

  predicted.joints = {};
  EXPECT_THROW(evaluate_pair(predicted, truth, quick()), InputError);
}

TEST(PairEvaluation, SoundnessIsOfThePredictionAlone) {
  PairSettings settings = quick();
  settings.groups = {"soundness"};
  const io::RiggedShape shape = test::rigged_walker();
  const PairResult sound = evaluate_pair(shape, with_random_placement(shape), settings);
  for (const MetricInfo& metric : metric_table()) {
    if (metric.group == "soundness") {
      EXPECT_EQ(sound.values.count(metric.key), 1u) << metric.key;
    }
  }
  EXPECT_EQ(sound.values.count("skin_l1"), 0u);

  // Every third vertex goes with a joint that its neighbours do not follow.
  io::RiggedShape torn = shape;
  torn.skin = {};
  for (std::size_t v = 0; v < shape.skin.rows(); ++v) {
    std::vector<Influence> row(shape.skin.row(v), shape.skin.row(v) + shape.skin.row_size(v));
    if (v % 3 == 0) row = {{static_cast<int>(shape.joints.size()) - 1, 1.0F}};
    torn.skin.append_row(std::move(row));
  }
  const PairResult broken = evaluate_pair(torn, shape, settings);
  EXPECT_GT(broken.value("sound_stretched"), sound.value("sound_stretched") + 0.05);

  io::RiggedShape bare = shape;
  bare.skin = {};
  EXPECT_EQ(evaluate_pair(bare, shape, settings).not_computed.at("sound_bleed"), "the prediction has no skin weights");
}

TEST(PairEvaluation, WeightsOfAnotherLengthAreNamed) {
  const io::RiggedShape truth = test::rigged_walker();
  io::RiggedShape predicted = truth;
  predicted.skin.offsets.pop_back();
  const PairResult result = evaluate_pair(predicted, truth, quick());
  EXPECT_NE(result.not_computed.at("skin_l1").find("weights for"), std::string::npos);
}

TEST(PairEvaluation, SavesAndReadsBack) {
  const io::RiggedShape shape = test::rigged_walker();
  PairResult result = evaluate_pair(with_inserted_joint(shape), shape, quick());
  result.notes.push_back("a note");
  const PairResult again = pair_result_from_json(to_json(result), "saved.json");
  EXPECT_EQ(again.values, result.values);
  EXPECT_EQ(again.not_computed, result.not_computed);
  EXPECT_EQ(again.notes, result.notes);
  EXPECT_THROW(pair_result_from_json(Json{{"id", 3}}, "saved.json"), InputError);
}

TEST(PairSettings, NamesWhatIsOutOfRange) {
  PairSettings settings;
  settings.groups = {"skeletn"};
  EXPECT_THROW(check(settings), InputError);
  settings = {};
  settings.poses = 0;
  EXPECT_THROW(check(settings), InputError);
  settings = {};
  settings.motion_frames = 0;
  EXPECT_THROW(check(settings), InputError);
  settings = {};
  EXPECT_NO_THROW(check(settings));
}

TEST(Fingerprint, ChangesWithEverythingThatIsMeasured) {
  const io::RiggedShape shape = test::rigged_walker(4);
  const std::uint64_t before = fingerprint(shape);
  EXPECT_EQ(fingerprint(test::rigged_walker(4)), before);
  io::RiggedShape changed = shape;
  changed.mesh.vertices[3].x() += 1e-3f;
  EXPECT_NE(fingerprint(changed), before);
  changed = shape;
  changed.joints.parents[2] = 1;
  EXPECT_NE(fingerprint(changed), before);
  changed = shape;
  changed.skin.influences[0].weight *= 0.99f;
  EXPECT_NE(fingerprint(changed), before);
  changed = shape;
  io::RigClips clips{skeleton_from_joints(shape.joints.positions, shape.joints.parents), {}};
  clips.animations.push_back({"nod", {{1, ChannelPath::kRotation, Interpolation::kLinear, {0.0}, {0, 0, 0, 1}}}});
  changed.clips = std::make_shared<io::RigClips>(clips);
  const std::uint64_t with_clip = fingerprint(changed);
  EXPECT_NE(with_clip, before);
  clips.animations[0].channels[0].values = {1, 0, 0, 0};
  changed.clips = std::make_shared<io::RigClips>(clips);
  EXPECT_NE(fingerprint(changed), with_clip);
  changed = shape;
  changed.mesh.normals.assign(changed.mesh.vertices.size(), Eigen::Vector3f::UnitX());
  EXPECT_NE(fingerprint(changed), before);
  changed = shape;
  std::swap(changed.mesh.faces[0], changed.mesh.faces[1]);
  EXPECT_NE(fingerprint(changed), before);
}

}  // namespace
}  // namespace anigen::eval
