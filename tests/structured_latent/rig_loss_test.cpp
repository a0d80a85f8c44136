#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/shape_field/mesh_extraction.h"
#include "anigen/structured_latent/rig_loss.h"

namespace anigen::structured_latent {
namespace {

using torch::Tensor;

constexpr auto kDouble = torch::kFloat64;

Tensor drawn_picture(std::uint64_t seed, std::vector<std::int64_t> shape) {
  torch::manual_seed(seed);
  return torch::rand(shape, kDouble);
}

// The definition, pixel by pixel.
double slow_ssim(const Tensor& a, const Tensor& b) {
  const Tensor window = shape_field::ssim_window().to(kDouble);
  const std::int64_t height = a.size(0), width = a.size(1);
  double sum = 0.0;
  for (std::int64_t y = 0; y < height; ++y) {
    for (std::int64_t x = 0; x < width; ++x) {
      double ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
      for (std::int64_t j = -5; j <= 5; ++j) {
        for (std::int64_t i = -5; i <= 5; ++i) {
          if (y + j < 0 || y + j >= height || x + i < 0 || x + i >= width) continue;
          const double w = window[j + 5][i + 5].item<double>();
          const double va = a[y + j][x + i].item<double>(), vb = b[y + j][x + i].item<double>();
          ma += w * va;
          mb += w * vb;
          aa += w * va * va;
          bb += w * vb * vb;
          ab += w * va * vb;
        }
      }
      sum += (2 * ma * mb + 1e-4) * (2 * (ab - ma * mb) + 9e-4) /
             ((ma * ma + mb * mb + 1e-4) * (aa - ma * ma + bb - mb * mb + 9e-4));
    }
  }
  return sum / static_cast<double>(height * width);
}

TEST(ImageLoss, SsimIsItsDefinition) {
  const Tensor a = drawn_picture(1, {2, 1, 9, 14}), b = 0.7 * a + 0.3 * drawn_picture(2, {2, 1, 9, 14});
  const Tensor found = shape_field::ssim(a, b);
  for (std::int64_t i = 0; i < 2; ++i) {
    // The window is stored in fp32.
    EXPECT_NEAR(found[i].item<double>(), slow_ssim(a[i][0], b[i][0]), 1e-6);
  }
  EXPECT_NEAR(shape_field::ssim(a, a).mean().item<double>(), 1.0, 1e-12);
  EXPECT_THROW(shape_field::ssim(a, b.slice(3, 0, 5)), InputError);
}

TEST(ImageLoss, SsimGradientAgreesWithFiniteDifferences) {
  const Tensor b = drawn_picture(5, {1, 2, 13, 12});
  Tensor a = (0.6 * b + 0.4 * drawn_picture(6, {1, 2, 13, 12})).requires_grad_();
  shape_field::ssim(a, b).sum().backward();
  const auto value = [&](std::int64_t i, double step) {
    Tensor moved = a.detach().clone();
    moved.view(-1)[i] += step;
    return shape_field::ssim(moved, b).sum().item<double>();
  };
  for (std::int64_t i = 0; i < a.numel(); i += 5) {  // corners, edges and the middle
    EXPECT_NEAR(a.grad().view(-1)[i].item<double>(), (value(i, 1e-6) - value(i, -1e-6)) / 2e-6, 1e-8) << i;
  }
}

TEST(ImageLoss, APerceptualLossHoldsWhatIsWeighted) {
  const Tensor a = drawn_picture(3, {1, 3, 16, 16}), b = drawn_picture(4, {1, 3, 16, 16});
  int calls = 0;
  const shape_field::PictureDistance distance = [&](const Tensor& x, const Tensor&) {
    ++calls;
    return torch::full({1}, 0.5, x.options());
  };
  const shape_field::PerceptualLoss all = shape_field::perceptual_loss(a, b, {0.25, 2.0}, distance);
  const double l1 = (a - b).abs().mean().item<double>(), s = 1.0 - shape_field::ssim(a, b).mean().item<double>();
  EXPECT_NEAR(all.total.item<double>(), l1 + 0.25 * s + 2.0 * 0.5, 1e-12);
  const shape_field::PerceptualLoss plain = shape_field::perceptual_loss(a, b, {0.0, 0.0}, distance);
  EXPECT_NEAR(plain.total.item<double>(), l1, 1e-12);
  EXPECT_FALSE(plain.ssim.defined());
  EXPECT_EQ(calls, 1);
  EXPECT_THROW(shape_field::perceptual_loss(a, b, {0.0, 1.0}, nullptr), InputError);
}

TEST(ImageLoss, NormalAnglesLeaveOutZeros) {
  const Tensor a = torch::tensor({{1.0, 0.5, 0.5}, {0.5, 0.5, 0.5}}, kDouble);  // x, and nothing
  const Tensor b = torch::tensor({{0.5, 1.0, 0.5}, {0.5, 1.0, 0.5}}, kDouble);
  EXPECT_NEAR(shape_field::normal_angle(a, b).item<double>(), 90.0, 1e-6);
  EXPECT_EQ(shape_field::normal_angle(a.slice(0, 1), b.slice(0, 1)).item<double>(), 0.0);
}

// A camera two units in front of the origin that looks along +z of the world.
struct FrontCamera {
  Tensor extrinsics = torch::eye(4, kDouble), intrinsics = torch::eye(3, kDouble);
  FrontCamera() {
    extrinsics.index_put_({2, 3}, 2.0);
    intrinsics.index_put_({0, 2}, 0.5);
    intrinsics.index_put_({1, 2}, 0.5);
  }
};

TEST(GeometryLoss, SignedDistancesAreThoseOfAWall) {
  const FrontCamera camera;
  const Tensor depth = torch::full({8, 8}, 2.0, kDouble);  // a wall through the origin
  const Tensor points = torch::tensor({{0.0, 0.0, 0.0}, {0.1, 0.0, -0.01}, {0.0, 0.2, -0.4}, {0.0, 0.0, 0.4}}, kDouble);
  const Tensor sdf = torch::tensor({0.0, 0.03, 0.0, 9.0}, kDouble).requires_grad_();
  const std::int64_t resolution = 30;  // truncation 0.1
  const Tensor loss = shape_field::tsdf_loss(points, sdf, depth, camera.extrinsics, camera.intrinsics, resolution);
  // In front of the wall: 0, 0.01 and 0.4, cut to 0.1; the last point lies too far behind.
  EXPECT_NEAR(loss.item<double>(), (0.0 + 0.02 * 0.02 + 0.1 * 0.1) / 3.0, 1e-12);
  loss.backward();
  EXPECT_EQ(sdf.grad()[3].item<double>(), 0.0);
  const Tensor nothing = shape_field::tsdf_loss(points.slice(0, 3), sdf.detach().slice(0, 3), depth, camera.extrinsics,
                                                camera.intrinsics, resolution);
  EXPECT_EQ(nothing.item<double>(), 0.0) << "no point in front of the truncation is no loss, not NaN";
}

TEST(GeometryLoss, NormalsAreTurnedToTheCamera) {
  const FrontCamera camera;
  Tensor normal = torch::full({1, 3, 4, 4}, 0.5, kDouble);
  normal.select(1, 2).fill_(1.0);  // away from the camera
  const Tensor turned =
      shape_field::facing_camera(normal, camera.extrinsics.unsqueeze(0), camera.intrinsics.unsqueeze(0));
  EXPECT_TRUE(torch::allclose(turned.select(1, 2), torch::zeros({1, 4, 4}, kDouble)));
  EXPECT_TRUE(torch::allclose(
      shape_field::facing_camera(turned, camera.extrinsics.unsqueeze(0), camera.intrinsics.unsqueeze(0)), turned));
}

TEST(GeometryLoss, OnlyWhatTheTrueShapeCoversCounts) {
  shape_field::SurfacePictures truth{torch::zeros({1, 1, 12, 12}, kDouble), torch::full({1, 1, 12, 12}, 2.0, kDouble),
                                     drawn_picture(5, {1, 3, 12, 12}), Tensor()};
  truth.mask.slice(2, 0, 6).fill_(1.0);
  shape_field::SurfacePictures predicted = truth;
  predicted.depth = truth.depth + 0.5 * (1.0 - truth.mask);
  predicted.normal = truth.normal * truth.mask;
  shape_field::GeometryLossOptions options;
  options.perceptual.lambda_lpips = 0.0;
  const shape_field::GeometryLosses losses = shape_field::geometry_losses(predicted, truth, Tensor(), options);
  EXPECT_NEAR(losses.total.item<double>(), 0.0, 1e-12);
  EXPECT_FALSE(losses.tsdf.defined());
  EXPECT_THROW(options.set_depth_loss("l2"), InputError);
}

TEST(GeometryLoss, ThePublishedColourLossHoldsItsDistanceTwice) {
  const Tensor image = drawn_picture(6, {1, 3, 16, 16}), color = drawn_picture(7, {1, 3, 16, 16});
  const Tensor alpha = torch::ones({1, 16, 16}, kDouble);
  shape_field::GeometryLossOptions options;
  options.perceptual = {0.0, 0.0};
  options.lambda_color = 0.1;
  const double l1 = (image - color).abs().mean().item<double>();
  EXPECT_NEAR(shape_field::color_loss(color, image, alpha, options).item<double>(), 1.1 * l1, 1e-12);
  options.extra_color_l1 = false;
  EXPECT_NEAR(shape_field::color_loss(color, image, alpha, options).item<double>(), 0.1 * l1, 1e-12);
}

// Two joints one apart, the first the root; voxels at a quarter of the way and beside the second joint.
struct TwoJoints {
  Tensor joints = torch::tensor({{0.0F, 0.0F, 0.0F}, {1.0F, 0.0F, 0.0F}});
  Tensor parents = torch::tensor({-1, 0}, torch::kInt32);
  Tensor positions = torch::tensor({{0.25F, 0.0F, 0.0F}, {1.0F, 0.0F, 0.0F}, {0.5F, 0.0F, 0.0F}});
  skeleton_field::SkeletonField field() const {
    skeleton_field::SkeletonField made;
    made.positions = positions;
    made.joints = positions.clone().requires_grad_();
    made.parents = positions.clone().requires_grad_();
    made.conf_j = torch::full({3, 1}, 0.5F).requires_grad_();
    made.conf_p = torch::full({3, 1}, 0.5F).requires_grad_();
    made.skin_features = torch::zeros({3, 2});
    return made;
  }
};

TEST(SkeletonLoss, TargetsFollowTheDefinition) {
  const TwoJoints two;
  const skeleton_field::SkeletonTargets published =
      skeleton_field::skeleton_targets(two.positions, two.joints, two.parents);
  EXPECT_TRUE(torch::equal(published.joint, torch::tensor({0, 1, 0}, torch::kInt64))) << "ties keep the first joint";
  EXPECT_TRUE(torch::equal(published.parent, torch::tensor({0, 0, 0}, torch::kInt64))) << "a root is its own parent";
  const float between = 1.0F - 0.0625F / 0.5625F;
  EXPECT_TRUE(torch::allclose(published.confidence, torch::tensor({{between}, {1.0F}, {0.1F}}), 1e-5, 1e-6));
  EXPECT_TRUE(torch::equal(published.weight, torch::ones({2})));
  const skeleton_field::SkeletonTargets paper = skeleton_field::skeleton_targets(
      two.positions, two.joints, two.parents, skeleton_field::SkeletonLossOptions::compatible("paper"));
  EXPECT_NEAR(paper.confidence[2][0].item<double>(), 0.0, 1e-6);
  // A joint next to another counts ten times, which is the most.
  const Tensor crowded = torch::tensor({{0.0F, 0.0F, 0.0F}, {1.0F, 0.0F, 0.0F}, {1.001F, 0.0F, 0.0F}});
  const skeleton_field::SkeletonTargets weights =
      skeleton_field::skeleton_targets(two.positions, crowded, torch::tensor({-1, 0, 1}, torch::kInt32));
  EXPECT_TRUE(torch::equal(weights.weight, torch::tensor({1.0F, 10.0F, 10.0F})));
  EXPECT_THROW(skeleton_field::skeleton_targets(two.positions, two.joints, torch::tensor({-1}, torch::kInt32)),
               InputError);
  EXPECT_THROW(skeleton_field::SkeletonLossOptions::compatible("other"), InputError);
}

TEST(SkeletonLoss, EveryConfidenceHasItsForm) {
  const TwoJoints two;
  skeleton_field::SkeletonLossOptions options;
  const skeleton_field::SkeletonTargets targets =
      skeleton_field::skeleton_targets(two.positions, two.joints, two.parents, options);
  const Tensor c = targets.confidence;
  const Tensor distance = torch::tensor({{0.25F, 0.0F, 0.0F}, {0.0F, 0.0F, 0.0F}, {0.5F, 0.0F, 0.0F}});
  const auto joints_loss = [&](skeleton_field::FieldConfidence confidence, const skeleton_field::SkeletonField& field) {
    options.confidence = confidence;
    return skeleton_field::skeleton_losses(field, targets, options).joints;
  };
  const skeleton_field::SkeletonField field = two.field();
  const double expected = ((c * distance).mean() + (0.5F - c).abs().mean()).item<double>();
  EXPECT_NEAR(joints_loss(skeleton_field::FieldConfidence::kExplicit, field).item<double>(), expected, 1e-6);
  EXPECT_NEAR(joints_loss(skeleton_field::FieldConfidence::kNone, field).item<double>(), distance.mean().item<double>(),
              1e-6);
  EXPECT_NEAR(joints_loss(skeleton_field::FieldConfidence::kLearned, field).item<double>(),
              (std::exp(0.5) + 1.0) * distance.mean().item<double>(), 1e-6);
  EXPECT_NEAR(joints_loss(skeleton_field::FieldConfidence::kBayesian, field).item<double>(),
              std::exp(-0.5) * distance.mean().item<double>() + 0.5, 1e-6);
  options.squared = true;
  EXPECT_NEAR(joints_loss(skeleton_field::FieldConfidence::kBayesian, field).item<double>(),
              0.5 * (std::exp(-0.5) * (0.0625 + 0.25) / 3.0 + 0.5), 1e-6);
  options.squared = false;
  skeleton_field::SkeletonField without = two.field();
  without.conf_j = Tensor();
  EXPECT_THROW(joints_loss(skeleton_field::FieldConfidence::kExplicit, without), InputError);
  EXPECT_NO_THROW(joints_loss(skeleton_field::FieldConfidence::kNone, without));
}

// e^(−s) d + s is least at s = log d: the scale is learned from the errors alone.
TEST(SkeletonLoss, TheBayesianScaleSettlesAtTheError) {
  const TwoJoints two;
  skeleton_field::SkeletonLossOptions options;
  options.confidence = skeleton_field::FieldConfidence::kBayesian;
  const skeleton_field::SkeletonTargets targets =
      skeleton_field::skeleton_targets(two.positions, two.joints, two.parents, options);
  skeleton_field::SkeletonField field = two.field();
  field.joints = targets.joints.index_select(0, targets.joint) + 0.05F;
  field.conf_j = torch::full({3, 1}, std::log(0.05F)).requires_grad_();
  skeleton_field::skeleton_losses(field, targets, options).joints.backward();
  EXPECT_LT(field.conf_j.grad().abs().max().item<double>(), 1e-5);
  field.conf_j = torch::full({3, 1}, -1e6F).requires_grad_();
  EXPECT_TRUE(std::isfinite(skeleton_field::skeleton_losses(field, targets, options).joints.item<double>()));
}

RigTruth truth_of(const TwoJoints& two) {
  RigTruth truth;
  truth.joints = two.joints;
  truth.parents = two.parents;
  truth.joint_features = torch::tensor({{1.0F, 0.0F}, {0.0F, 1.0F}});
  truth.skin = torch::tensor({{1.0F, 0.0F}, {0.0F, 1.0F}});
  truth.vertex_features = truth.joint_features;
  truth.mix = skin_field::nearest_vertex_mix(two.joints, two.joints);
  return truth;
}

RigPrediction prediction_of(const TwoJoints& two) {
  RigPrediction predicted;
  predicted.field = two.field();
  predicted.field.conf_skin = predicted.field.conf_j;
  predicted.joints = two.joints;
  predicted.variance = torch::tensor(0.25F);
  predicted.mesh = true;
  predicted.vertex_features = torch::zeros({2, 2}).requires_grad_();
  predicted.skin = torch::full({2, 2}, 0.5F).requires_grad_();
  return predicted;
}

TEST(RigLoss, SkinTermsCountGoodSkinOnSurfacesOnly) {
  const TwoJoints two;
  RigLossOptions options;
  const RigPrediction predicted = prediction_of(two);
  const RigTruth truth = truth_of(two);
  const RigLosses one = rig_losses({predicted}, {truth}, options);
  EXPECT_NEAR(one.skin_kl.item<double>(), std::log(2.0), 1e-6);
  EXPECT_NEAR(one.skin_feats_l2_vert.item<double>(), 0.5, 1e-6);
  EXPECT_NEAR(one.skin_feats_l2_joints.item<double>(), 0.5 * 0.5, 1e-6) << "weighted by the predicted confidence";
  EXPECT_NEAR(one.skin_var.item<double>(), 0.25, 1e-6);

  RigPrediction no_mesh = prediction_of(two);
  no_mesh.mesh = false;
  no_mesh.vertex_features = no_mesh.skin = Tensor();
  RigTruth bad = truth_of(two);
  bad.is_bad_skin = true;
  const RigLosses some = rig_losses({predicted, no_mesh, prediction_of(two)}, {truth, truth, bad}, options);
  EXPECT_NEAR(some.skin_kl.item<double>(), std::log(2.0) / 2.0, 1e-6) << "two surfaces, one of them with good skin";
  EXPECT_NEAR(some.joints.item<double>(), one.joints.item<double>(), 1e-6) << "all assets have joints";
  const RigLosses none = rig_losses({no_mesh}, {truth}, options);
  EXPECT_EQ(none.skin_kl.item<double>(), 0.0);

  options.true_feature_confidence = true;
  const double c =
      skeleton_field::skeleton_targets(two.positions, two.joints, two.parents).confidence.mean().item<double>();
  EXPECT_NEAR(rig_losses({predicted}, {truth}, options).skin_feats_l2_joints.item<double>(), 0.5 * c, 1e-6);
  EXPECT_THROW(rig_losses({predicted}, {}, options), InputError);
}

TEST(RigLoss, GroupedJointsTakeTheColumnOfTheNearestTrueJoint) {
  const TwoJoints two;
  const RigTruth truth = truth_of(two);
  const Tensor grouped = torch::tensor({{0.9F, 0.0F, 0.0F}, {0.1F, 0.0F, 0.0F}, {1.1F, 0.0F, 0.0F}});
  const skin_field::SkinTargets targets =
      skin_field::skin_targets(truth.mix, truth.skin, Tensor(), truth.joints, grouped);
  EXPECT_TRUE(torch::allclose(targets.weights, torch::tensor({{0.0F, 1.0F, 0.0F}, {0.5F, 0.0F, 0.5F}})));
  EXPECT_FALSE(targets.features.defined());
  EXPECT_THROW(skin_field::skin_weight_kl(targets.weights, truth.skin), InputError);
}

TEST(StructuredLatentVariant, NormsAndConfidencesAreThoseItNames) {
  StructuredLatentEncoderOptions encoder;
  const Tensor z = torch::tensor({{0.6F, -0.8F}, {0.0F, 0.0F}});
  EXPECT_TRUE(torch::equal(renormalized(z, encoder, LatentNorm::kL2), z));
  const Tensor l1 = renormalized(z, encoder, LatentNorm::kL1);
  EXPECT_NEAR(l1[0].abs().sum().item<double>(), 1.0, 1e-6);
  EXPECT_EQ(l1[1].abs().sum().item<double>(), 0.0);
  StructuredLatentVariant variant;
  variant.latent_norm = LatentNorm::kL1;
  EXPECT_TRUE(torch::equal(geometry_latent(z, encoder, variant), z)) << "a posterior stays";
  variant.geometry_dae = true;
  EXPECT_TRUE(torch::equal(geometry_latent(2.0 * z, encoder, variant), l1));
  variant.latent_norm = LatentNorm::kL2;
  EXPECT_TRUE(torch::allclose(geometry_latent(2.0 * z, encoder, variant), z));
  variant.latent_norm = LatentNorm::kNone;
  EXPECT_TRUE(torch::equal(geometry_latent(2.0 * z, encoder, variant), 2.0 * z));

  skeleton_field::SkeletonField field;
  field.conf_j = torch::linspace(-3.0F, 3.0F, 200).unsqueeze(1);
  field.conf_p = field.conf_j;
  const Tensor mapped = for_grouping(field, skeleton_field::FieldConfidence::kBayesian).conf_j;
  EXPECT_EQ(mapped.max().item<double>(), 1.0);
  EXPECT_GT(mapped.min().item<double>(), 0.0);
  EXPECT_TRUE((mapped.slice(0, 1) <= mapped.slice(0, 0, -1)).all().item<bool>()) << "a larger scale is less certain";
  EXPECT_TRUE(torch::equal(for_grouping(field, skeleton_field::FieldConfidence::kExplicit).conf_j, field.conf_j));
}

TEST(StructuredLatentVariant, ContradictionsAreErrors) {
  StructuredLatentDecoderOptions decoder;  // jp_hyper_continuous
  const auto read = [&](const Json& args) {
    ConfigReader reader(args, "config.json", "/trainer/args");
    return StructuredLatentVariant::read(reader, decoder, "published");
  };
  EXPECT_EQ(read(Json::object()).grouping, skeleton_field::MeanShiftForm::kPublished);
  EXPECT_EQ(read({{"grouping", "paper"}}).grouping, skeleton_field::MeanShiftForm::kPaper);
  EXPECT_EQ(in_form_of({}, read({{"grouping", "paper"}})).form, skeleton_field::MeanShiftForm::kPaper);
  EXPECT_TRUE(read({{"geometry_latent", "dae"}}).geometry_dae);
  EXPECT_EQ(read(Json::object()).confidence, skeleton_field::FieldConfidence::kExplicit);
  EXPECT_THROW(read({{"confidence", "bayesian"}}), InputError);
  EXPECT_THROW(read({{"confidence", "none"}}), InputError);
  decoder.jp_hyper_continuous = false;
  decoder.use_conf_jp = true;
  EXPECT_EQ(read(Json::object()).confidence, skeleton_field::FieldConfidence::kLearned);
  EXPECT_EQ(read({{"confidence", "bayesian"}}).confidence, skeleton_field::FieldConfidence::kBayesian);
  decoder.use_conf_jp = false;
  EXPECT_EQ(read({{"confidence", "none"}}).confidence, skeleton_field::FieldConfidence::kNone);
  EXPECT_FALSE(read({{"skin_ae", "joint"}}).needs_skin_ae());
  EXPECT_FALSE(read({{"geometry_only", true}}).needs_skin_ae());
}

}  // namespace
}  // namespace anigen::structured_latent
