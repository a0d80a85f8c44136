// Losses of the structured-latent auto-encoder: pictures, geometry from given pictures, skeleton and skin.
#include <algorithm>
#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "anigen/shape_field/mesh_extraction.h"
#include "anigen/structured_latent/rig_loss.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

void run_image_terms(Fixture& fixture) {
  const Json& config = fixture.config();
  const Tensor a = fixture.input("img1").requires_grad_(), b = fixture.input("img2");
  fixture.check_true("window of 11 pixels", config.at("window_size") == 11);
  fixture.check("window", shape_field::ssim_window());
  fixture.check("l1", at::l1_loss(a, b));
  fixture.check("l2", at::mse_loss(a, b));
  fixture.check("psnr", shape_field::psnr(a, b));
  const Tensor smooth = at::smooth_l1_loss(a, b, at::Reduction::Mean, config.at("beta").get<double>());
  fixture.check("smooth_l1", smooth);
  const Tensor ssim = shape_field::ssim(a, b);
  fixture.check("ssim_per_image", ssim);
  fixture.check("ssim", ssim.mean());
  fixture.check("normal_angle", shape_field::normal_angle(fixture.input("normals1"), fixture.input("normals2")));
  fixture.check("grad_ssim_img1", torch::autograd::grad({ssim.mean()}, {a})[0]);
  fixture.check("grad_smooth_img1", torch::autograd::grad({smooth}, {a})[0]);
}

void run_geometry_loss(Fixture& fixture) {
  const Json& config = fixture.config();
  shape_field::GeometryLossOptions options;
  options.perceptual.lambda_ssim = config.at("lambda_ssim");
  options.perceptual.lambda_lpips = config.at("lambda_lpips");
  options.lambda_depth = config.at("lambda_depth");
  options.lambda_tsdf = config.at("lambda_tsdf");
  options.lambda_color = config.at("lambda_color");
  options.resolution = config.at("res");
  const Tensor extrinsics = fixture.input("extrinsics"), intrinsics = fixture.input("intrinsics");

  // The fixture stands for the network by the values it returned, in the order of the calls.
  const Tensor lpips_values = fixture.input("lpips_values");
  std::int64_t call = 0;
  const shape_field::PictureDistance lpips = [&](const Tensor&, const Tensor&) { return lpips_values[call++]; };

  shape_field::SurfacePictures truth{fixture.input("gt_mask"), fixture.input("gt_depth"),
                                     shape_field::facing_camera(fixture.input("gt_normal"), extrinsics, intrinsics),
                                     fixture.input("gt_normal_map")};
  fixture.check("flipped_normal", truth.normal);
  const Tensor depth = fixture.input("depth").requires_grad_();
  const shape_field::SurfacePictures predicted{fixture.input("mask"), depth, fixture.input("normal"),
                                               fixture.input("normal_map")};

  const Tensor points = fixture.input("tsdf_v"), sdf = fixture.input("tsdf_s").requires_grad_();
  const std::int64_t items = points.size(0);
  std::vector<Tensor> uv, depths;
  Tensor tsdf;
  for (std::int64_t i = 0; i < items; ++i) {
    const shape_field::ProjectedPoints seen = shape_field::project_points(points[i], extrinsics[i], intrinsics[i]);
    uv.push_back(seen.uv);
    depths.push_back(seen.depth);
    const Tensor one =
        shape_field::tsdf_loss(points[i], sdf[i], truth.depth[i][0], extrinsics[i], intrinsics[i], options.resolution);
    tsdf = i == 0 ? one : tsdf + one;
  }
  fixture.check("proj_uv", torch::stack(uv));
  fixture.check("pts_depth", torch::stack(depths));

  const shape_field::GeometryLosses losses =
      shape_field::geometry_losses(predicted, truth, tsdf / static_cast<double>(items), options, lpips);
  fixture.check("tsdf_loss", losses.tsdf);
  fixture.check("mask_loss", losses.mask);
  fixture.check("depth_loss", losses.depth);
  fixture.check("normal_loss", losses.normal);
  fixture.check("normal_loss_ssim", losses.normal_ssim);
  fixture.check("normal_loss_perceptual", losses.normal_perceptual);
  fixture.check("normal_map_loss_perceptual", losses.normal_map_perceptual);
  fixture.check("geo_loss", losses.total);
  const auto gradients = torch::autograd::grad({losses.total}, {sdf, depth});
  fixture.check("grad_tsdf_s", gradients[0]);
  fixture.check("grad_depth", gradients[1]);
  fixture.check("color_loss", shape_field::color_loss(fixture.input("color"), fixture.input("image"),
                                                      fixture.input("alpha"), options, lpips));

  options.set_depth_loss("smooth_l1");
  options.perceptual.lambda_lpips = 0.0;
  fixture.check("depth_loss_smooth", shape_field::geometry_losses(predicted, truth, Tensor(), options).depth);
}

// The predictions of one asset in one case, which gradients are asked for.
struct AssetInputs {
  AssetInputs(const Fixture& fixture, std::size_t item) : fixture_(fixture), prefix_("i" + std::to_string(item) + ".") {
    for (const char* name :
         {"joints_pred", "parents_pred", "conf_j", "conf_p", "vert_skin_pred", "joint_skin_pred", "skin_pred"}) {
      leaves[name] = get(name).clone().requires_grad_();
    }
  }
  Tensor get(const std::string& name) const { return fixture_.input(prefix_ + name); }

  std::map<std::string, Tensor> leaves;

 private:
  const Fixture& fixture_;
  std::string prefix_;
};

structured_latent::RigPrediction prediction_of(AssetInputs& inputs, const Json& described, bool success) {
  structured_latent::RigPrediction predicted;
  skeleton_field::SkeletonField& field = predicted.field;
  field.positions = inputs.get("positions");
  field.joints = inputs.leaves["joints_pred"];
  field.parents = inputs.leaves["parents_pred"];
  field.skin_features = inputs.leaves["joint_skin_pred"];
  if (described.at("conf").get<bool>()) {
    field.conf_j = inputs.leaves["conf_j"];
    field.conf_p = inputs.leaves["conf_p"];
    // The decoder's rule: where joints have an explicit confidence, it also weights their features.
    if (described.at("jp_hyper_continuous").get<bool>()) field.conf_skin = field.conf_j;
  }
  predicted.joints = inputs.get("joints_grouped");
  predicted.variance = inputs.get("var_loss");
  predicted.mesh = success;
  predicted.vertex_features = inputs.leaves["vert_skin_pred"];
  predicted.skin = inputs.leaves["skin_pred"];
  return predicted;
}

structured_latent::RigTruth truth_of(const AssetInputs& inputs, const Json& described, bool bad) {
  structured_latent::RigTruth truth;
  truth.joints = inputs.get("joints_gt");
  truth.parents = inputs.get("parents_gt");
  truth.joint_features = inputs.get("joint_skin_gt");
  truth.skin = inputs.get("skin_gt");
  truth.vertex_features = inputs.get("vert_skin_gt");
  truth.mix = described.at("bvh").get<bool>()
                  ? skin_field::surface_mix(inputs.get("face_id"), inputs.get("uvw"), inputs.get("gt_faces"),
                                            skin_field::kLossLeastWeight)
                  : skin_field::nearest_vertex_mix(inputs.get("gt_vertices"), inputs.get("pred_vertices"));
  truth.is_bad_skin = bad;
  return truth;
}

structured_latent::RigLossOptions rig_options(const Json& config) {
  structured_latent::RigLossOptions options;
  const Json& lambdas = config.at("lambdas");
  options.lambda_joints = lambdas.at("joints");
  options.lambda_parents = lambdas.at("parents");
  options.lambda_skin_var = lambdas.at("skin_var");
  options.lambda_skin_kl = lambdas.at("skin_kl");
  options.lambda_skin_feats_l2 = lambdas.at("skin_feats_l2");
  options.lambda_skin_feats_l2_skl = lambdas.at("skin_feats_l2_skl");
  options.skeleton.alpha_conf_j = config.at("alpha_conf_j");
  options.skeleton.alpha_conf_p = config.at("alpha_conf_p");
  return options;
}

void check_targets(Fixture& fixture, std::size_t items) {
  for (std::size_t i = 0; i < items; ++i) {
    const AssetInputs inputs(fixture, i);
    const skeleton_field::SkeletonTargets targets =
        skeleton_field::skeleton_targets(inputs.get("positions"), inputs.get("joints_gt"), inputs.get("parents_gt"));
    const std::string suffix = "_i" + std::to_string(i);
    fixture.check("nn_idx" + suffix, targets.joint);
    fixture.check("factor" + suffix, targets.confidence);
    fixture.check("weights" + suffix, targets.weight);
  }
}

void run_case(Fixture& fixture, const Json& described, std::size_t items) {
  const std::string name = described.at("name");
  structured_latent::RigLossOptions options = rig_options(fixture.config());
  const bool confidence = described.at("conf"), hyper = described.at("jp_hyper_continuous");
  options.skeleton.confidence = hyper        ? skeleton_field::FieldConfidence::kExplicit
                                : confidence ? skeleton_field::FieldConfidence::kLearned
                                             : skeleton_field::FieldConfidence::kNone;
  std::vector<AssetInputs> inputs;
  std::vector<structured_latent::RigPrediction> predictions;
  std::vector<structured_latent::RigTruth> truths;
  for (std::size_t i = 0; i < items; ++i) {
    inputs.emplace_back(fixture, i);
    predictions.push_back(prediction_of(inputs.back(), described, described.at("success").at(i)));
    truths.push_back(truth_of(inputs.back(), described, described.at("bad").at(i)));
  }
  const structured_latent::RigLosses losses = structured_latent::rig_losses(predictions, truths, options);
  const Tensor total = losses.total(options);
  total.backward();
  fixture.check(name + ".terms", torch::stack({losses.joints, losses.parents, losses.skin_var, losses.skin_kl,
                                               losses.skin_feats_l2_vert, losses.skin_feats_l2_joints}));
  fixture.check(name + ".total", total);
  const std::vector<std::string> outputs = fixture.outputs();
  for (std::size_t i = 0; i < items; ++i) {
    for (const auto& [leaf, tensor] : inputs[i].leaves) {
      const std::string output = name + ".grad_i" + std::to_string(i) + "." + leaf;
      if (std::find(outputs.begin(), outputs.end(), output) == outputs.end()) continue;
      fixture.check(output, tensor.grad().defined() ? tensor.grad() : torch::zeros_like(tensor));
    }
  }
}

void run_rig_loss(Fixture& fixture) {
  const std::size_t items = fixture.config().at("items").size();
  check_targets(fixture, items);
  for (const Json& described : fixture.config().at("cases")) run_case(fixture, described, items);
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(ops_loss_image_terms, anigen::test::run_image_terms)
ANIGEN_DEVICE_PARITY(ops_loss_slat_geometry, anigen::test::run_geometry_loss)
ANIGEN_DEVICE_PARITY(ops_loss_slat_skeleton, anigen::test::run_rig_loss)
