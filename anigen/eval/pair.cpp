#include "anigen/eval/pair.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/table.h"
#include "anigen/core/text.h"
#include "anigen/eval/merged_joints.h"
#include "anigen/geometry/correspondence.h"
#include "anigen/geometry/visible_surface.h"
#include "anigen/lint/lint.h"
#include "anigen/metrics/chamfer.h"
#include "anigen/metrics/deformation.h"
#include "anigen/metrics/matching.h"
#include "anigen/metrics/published_protocols.h"
#include "anigen/metrics/skin_metrics.h"
#include "anigen/metrics/surface.h"
#include "anigen/metrics/tree_edit.h"
#include "anigen/metrics/wasserstein.h"

namespace anigen::eval {

namespace {

Json to_json(const metrics::IcpOptions& icp) {
  return {{"rotations", icp.rotations},
          {"principal_axes", icp.principal_axes},
          {"samples", icp.samples},
          {"score_samples", icp.score_samples},
          {"max_iterations", icp.max_iterations},
          {"variant", icp.variant == metrics::IcpVariant::kPointToPlane ? "point-to-plane" : "point-to-point"},
          {"scale", icp.similarity},
          {"trim", icp.trim},
          {"to_surface", icp.to_surface},
          {"exhaustive", icp.exhaustive}};
}

/// Options of skeleton_transport(). Gromov–Wasserstein with Sinkhorn searches nothing besides.
metrics::TransportOptions transport_options(const PairSettings& settings) {
  metrics::TransportOptions options;
  options.sinkhorn = settings.transport == TransportMethod::kSinkhorn;
  if (settings.epsilon) options.sinkhorn_options.epsilon = options.entropic_options.epsilon = *settings.epsilon;
  return options;
}

Json transport_json(const PairSettings& settings) {
  if (settings.transport == TransportMethod::kExact) return {{"solver", "exact"}};
  const metrics::TransportOptions options = transport_options(settings);
  return {{"solver", "sinkhorn"},
          {"epsilon_wasserstein", options.sinkhorn_options.epsilon},
          {"epsilon_gromov_wasserstein", options.entropic_options.epsilon}};
}

Json alignment_json(const metrics::Similarity& similarity) {
  Json rows = Json::array();
  const Eigen::Matrix4d matrix = similarity.matrix();
  for (int row = 0; row < 4; ++row) rows.push_back({matrix(row, 0), matrix(row, 1), matrix(row, 2), matrix(row, 3)});
  return rows;
}

Json alignment_json(const metrics::Alignment& alignment) {
  Json json = {{"by", metrics::to_string(alignment.by)},
               {"prediction_to_frame", alignment_json(alignment.prediction)},
               {"truth_to_frame", alignment_json(alignment.truth)}};
  if (alignment.icp_used) {
    json["icp"] = {{"rmse", alignment.icp.rmse},
                   {"start", alignment.icp.start},
                   {"starts", alignment.icp.starts},
                   {"refined", alignment.icp.refined},
                   {"iterations", alignment.icp.iterations}};
  }
  return json;
}

Json sizes(const io::RiggedShape& shape) {
  return {{"joints", shape.joints.size()},
          {"roots", roots(shape.joints).size()},
          {"vertices", shape.mesh.vertices.size()},
          {"faces", shape.mesh.faces.size()}};
}

void copy_notes(const io::RiggedShape& shape, const std::string& side, PairResult& result) {
  for (const std::string& note : shape.notes) result.notes.push_back(side + ": " + note);
}

/// Reason why a group cannot be computed, or nothing.
std::string missing_joints(const ComparedShapes& shapes) {
  if (!shapes.truth.has_joints()) return "the ground truth has no skeleton";
  if (!shapes.predicted.has_joints()) return "the prediction has no skeleton";
  return "";
}

std::string missing_skin(const io::RiggedShape& shape, const std::string& side) {
  if (shape.has_skin()) return "";
  if (shape.skin.rows() == 0) return side + " has no skin weights";
  return side + " has weights for " + std::to_string(shape.skin.rows()) + " of " +
         std::to_string(shape.mesh.vertices.size()) + " vertices";
}

std::string missing_skin(const ComparedShapes& shapes) {
  std::string missing = missing_joints(shapes);
  if (missing.empty()) missing = missing_skin(shapes.truth, "the ground truth");
  if (missing.empty()) missing = missing_skin(shapes.predicted, "the prediction");
  return missing;
}

std::string missing_surface(const ComparedShapes& shapes) {
  if (!shapes.truth.has_surface()) return "the ground truth has no faces";
  if (!shapes.predicted.has_surface()) return "the prediction has no faces";
  return "";
}

std::string missing_to_move(const ComparedShapes& shapes) {
  const std::string missing = missing_skin(shapes);
  return missing.empty() ? missing_surface(shapes) : missing;
}

/// Gives every metric of a group the same reason.
void skip_group(const std::string& group, const std::string& reason, PairResult& result) {
  for (const MetricInfo& metric : metric_table()) {
    if (metric.group == group && result.values.count(metric.key) == 0) result.skip(metric.key, reason);
  }
}

/// One group that cannot be computed leaves the others alone.
void add_group(const std::string& group, const std::string& missing, const std::function<void()>& add,
               PairResult& result) {
  if (!missing.empty()) return skip_group(group, missing, result);
  try {
    add();
  } catch (const InputError& error) {
    skip_group(group, error.what(), result);
  }
}

constexpr double kMarginalsAlmostKept = 1e-3;  ///< L1 of masses that sum to 1
constexpr double kAnymateBox = 2.0;            ///< longest side of its frame; ours is 1

/// Predicted and true skeleton, checked.
std::pair<metrics::MetricSkeleton, metrics::MetricSkeleton> skeletons_of(const ComparedShapes& shapes) {
  return {{shapes.predicted.joints, "predicted skeleton"}, {shapes.truth.joints, "true skeleton"}};
}

/// True when anything but the renderer's grey would be seen.
bool has_colors(const io::RiggedShape& shape) {
  if (!shape.mesh.colors.empty()) return true;
  for (const Material& material : shape.materials) {
    if (material.image >= 0 || material.base_color != Eigen::Vector4f::Ones()) return true;
  }
  return false;
}

constexpr std::size_t kMostSamples = 5000;  ///< per frame: many frames make up for few samples
constexpr double kNotedScaling = 0.01;

/// Chamfer distances of all protocols, joint matching, connectivity, tree edit distance.
void add_skeleton_metrics(const ComparedShapes& shapes, PairResult& result) {
  const auto [predicted, truth] = skeletons_of(shapes);
  for (const metrics::SkeletonProtocol protocol : metrics::kSkeletonProtocols) {
    const std::string prefix = protocol == metrics::SkeletonProtocol::kPaper ? "" : metrics::name(protocol) + ".";
    try {
      const metrics::SkeletonChamfer chamfer = metrics::skeleton_chamfer(predicted, truth, protocol);
      result.set(prefix + "j2j", chamfer.j2j);
      result.set(prefix + "j2b", chamfer.j2b);
      result.set(prefix + "b2b", chamfer.b2b);
    } catch (const InputError& error) {
      for (const char* key : {"j2j", "j2b", "b2b"}) result.skip(prefix + key, error.what());
    }
  }
  // The tolerance of joint matching is half the thickness of the true shape at each joint, where there is a shape.
  std::vector<double> tolerance(truth.size(), metrics::kFixedTolerance);
  if (shapes.truth.has_surface())
    tolerance = metrics::joint_tolerances(truth, geometry::RayCaster(shapes.truth.mesh));
  else
    result.notes.push_back("joints matched within 0.05: without a true surface there is no thickness to go by");
  const metrics::JointMatch match = metrics::match_joints(predicted, truth, tolerance);
  result.set("rignet.iou", match.iou);
  result.set("rignet.precision", match.precision);
  result.set("rignet.recall", match.recall);
  const metrics::ConnectivityScore bones = metrics::connectivity(predicted, truth, match.truth_of);
  result.set("connectivity_precision", bones.precision);
  result.set("connectivity_recall", bones.recall);
  result.set("joints", static_cast<double>(predicted.size()));
  result.set("joint_count_error", static_cast<double>(metrics::joint_count_error(predicted, truth)));
  if (const auto edits = metrics::tree_edit_distance(predicted, truth))
    result.set("tree_edit_distance", *edits);
  else
    result.skip("tree_edit_distance", "too many joints for it");
}

/// Wasserstein, Gromov–Wasserstein, fused; the first two by the method that the settings ask for.
void add_transport_metrics(const ComparedShapes& shapes, const PairSettings& settings, PairResult& result) {
  const metrics::TransportOptions options = transport_options(settings);
  const auto [predicted, truth] = skeletons_of(shapes);
  const metrics::SkeletonTransport transport = metrics::skeleton_transport(predicted, truth, options);
  result.set("wasserstein", options.sinkhorn ? transport.sinkhorn_wasserstein : transport.wasserstein);
  result.set("gromov_wasserstein",
             options.sinkhorn ? transport.entropic_gromov_wasserstein : transport.gromov_wasserstein);
  result.set("gw_lower_bound", transport.gw_lower_bound);
  result.set("fused_gromov_wasserstein", transport.fused_gromov_wasserstein);
  result.details["gw_start"] = options.sinkhorn ? "entropic" : transport.gw_start;
  result.details["fgw_start"] = transport.fgw_start;
  if (!options.sinkhorn) return;
  result.details["sinkhorn"] = {{"squared_wasserstein_gap", transport.sinkhorn_gap},
                                {"wasserstein_converged", transport.sinkhorn_converged},
                                {"gromov_wasserstein_marginal_error", transport.entropic_marginal_error}};
  if (!transport.sinkhorn_converged)
    result.notes.push_back("Sinkhorn's iterations for the Wasserstein distance stopped before their tolerance");
  if (!(transport.entropic_marginal_error < kMarginalsAlmostKept))
    result.notes.push_back(
        "Sinkhorn's scaling for the Gromov–Wasserstein distance left double precision and its plan was repaired: a "
        "larger --sinkhorn-epsilon keeps it");
}

/// Anymate's joint metrics in its frame, the box of side 2.
void add_anymate_metrics(const ComparedShapes& shapes, PairResult& result) {
  const auto doubled = [](std::vector<Eigen::Vector3d> points) {
    for (Eigen::Vector3d& point : points) point *= kAnymateBox;
    return points;
  };
  const std::vector<Eigen::Vector3d> predicted = doubled(shapes.predicted.joints.positions);
  const std::vector<Eigen::Vector3d> truth = doubled(shapes.truth.joints.positions);
  const metrics::AnymateJointScore score = metrics::anymate_joint(predicted, truth);
  if (!score.not_computed.empty()) return skip_group("anymate", score.not_computed, result);
  result.set("anymate_cd", score.cd);
  result.set("anymate_emd", score.emd.cost);
  result.set("anymate_precision", score.precision);
  result.set("anymate_recall", score.recall);
  result.set("anymate_emd_exact", metrics::wasserstein1(predicted, truth).distance);
}

/// Puppeteer's scores, which leave larger skeletons out, and vertices whose true weights were not whole in the file.
void add_puppeteer_skin(const metrics::SkinMatrixView& predicted, metrics::SkinMatrix truth,
                        const std::vector<std::size_t>& not_whole, PairResult& result) {
  for (const std::size_t v : not_whole) truth.row(static_cast<Eigen::Index>(v)).setZero();
  const bool too_large = truth.cols() > static_cast<Eigen::Index>(metrics::kPuppeteerMostJoints);
  const auto puppeteer = too_large ? metrics::PuppeteerSkinScore{} : metrics::puppeteer_skin(predicted, truth);
  if (puppeteer.kept > 0) {
    result.set("puppeteer.skin_precision", puppeteer.overlap.precision);
    result.set("puppeteer.skin_recall", puppeteer.overlap.recall);
    result.set("puppeteer.skin_l1", puppeteer.l1);
    return;
  }
  const std::string most = std::to_string(metrics::kPuppeteerMostJoints), joints = std::to_string(truth.cols());
  for (const char* key : {"puppeteer.skin_precision", "puppeteer.skin_recall", "puppeteer.skin_l1"})
    result.skip(
        key, too_large ? "Puppeteer scores no weights of more than " + most + " joints; the ground truth has " + joints
                       : "no vertex of the ground truth has weights that sum to 1");
}

/// Weights moved to the true vertices, joints matched by matching_plan(); deformation error.
void add_skin_metrics(const ComparedShapes& shapes, const Eigen::MatrixXd& plan, const PairSettings& settings,
                      PairResult& result) {
  const io::RiggedShape &predicted = shapes.predicted, &truth = shapes.truth;
  const std::vector<Eigen::Vector3d> vertices = in_double(truth.mesh.vertices);

  SkinWeights moved;
  if (predicted.has_surface()) {
    moved = geometry::transfer_skin_to_mesh(predicted.mesh, predicted.skin, truth.mesh);
  } else {
    moved = geometry::transfer_skin_by_vertex(in_double(predicted.mesh.vertices), predicted.skin, vertices);
    result.notes.push_back("predicted weights taken from the nearest point: the prediction has no faces");
  }

  const std::size_t count = vertices.size(), joints = truth.joints.size();
  const std::vector<double> matched = metrics::matched_weights(moved, plan);
  const std::vector<float> dense_truth = to_dense(truth.skin, joints);
  const metrics::SkinScore score =
      metrics::score_skin(metrics::single_precision(matched), dense_truth, count, joints).mean;
  result.set("skin_l1", score.l1);
  result.set("skin_l2", score.l2);
  result.set("skin_kl", score.kl);

  const auto matched_matrix = metrics::skin_matrix(matched, count, joints);
  const metrics::SkinMatrix truth_matrix = metrics::skin_matrix(dense_truth, count, joints);
  const metrics::SkinOverlap overlap = metrics::rignet_skin_overlap(matched_matrix, truth_matrix);
  result.set("skin_precision", overlap.precision);
  result.set("skin_recall", overlap.recall);
  add_puppeteer_skin(matched_matrix, truth_matrix, truth.not_whole, result);
  const metrics::AnymateSkinScore anymate = metrics::anymate_skin(matched_matrix, truth_matrix);
  result.set("skin_ce", anymate.cross_entropy);
  result.set("skin_cos", 1.0 - anymate.cos_loss);
  result.set("skin_mae", anymate.mae);

  metrics::DeformationOptions deformation;
  deformation.poses = settings.poses;
  deformation.seed = settings.seed;
  const metrics::DeformationError error =
      metrics::deformation_error(vertices, truth.joints, truth.skin, predicted.joints, moved, plan, deformation);
  result.set("deformation_error", error.mean);
  result.details["largest_deformation_error"] = error.max;
}

/// Both meshes in the truth's motion. @param given a motion for the truth in place of its own; null: its own
void add_motion_metrics(const ComparedShapes& shapes, const PairSettings& settings, const metrics::Motion* given,
                        PairResult& result) {
  const MovedPair moved = same_motion(shapes, settings, given);
  metrics::MotionScoreOptions options;
  options.samples = std::min(settings.surface_samples, kMostSamples);
  options.seed = settings.seed;
  const metrics::MotionScore score =
      metrics::motion_score(shapes.truth, moved.truth, shapes.predicted, moved.predicted, options);
  result.set("motion_distance", score.moving);
  result.set("motion_distance_rest", score.rest);
  result.details["motion"] = {{"clip", moved.truth.name},
                              {"frames", moved.truth.frames.size()},
                              {"distance", score.by_vertex ? "vertices" : "surfaces"},
                              {"largest", score.largest}};
  if (moved.truth.scaling > kNotedScaling) {
    result.notes.push_back("the clip scales joints by up to " + std::to_string(moved.truth.scaling) +
                           " from 1, which motion_distance leaves out on both sides");
  }
}

void add_surface_metrics(const ComparedShapes& shapes, const PairSettings& settings, PairResult& result) {
  metrics::SurfaceOptions options;
  options.samples = settings.surface_samples;
  options.seed = settings.seed;
  const metrics::SurfaceScores scores =
      metrics::surface_scores(shapes.visible_predicted ? *shapes.visible_predicted : shapes.predicted.mesh,
                              shapes.visible_truth ? *shapes.visible_truth : shapes.truth.mesh, options);
  result.set("surface_chamfer", scores.chamfer);
  result.set("fscore", scores.fscore_005);
  result.set("fscore_001", scores.fscore_001);
  result.set("normal_consistency", scores.normal_consistency);
  result.details["hausdorff"] = scores.hausdorff;
}

/// The visible part of a shape's surface, with its joints; a shape without faces as it is.
io::RiggedShape visible_part(const io::RiggedShape& shape) {
  if (!shape.has_surface()) return shape;
  io::RiggedShape visible;
  visible.file = shape.file;
  visible.id = shape.id;
  visible.joints = shape.joints;
  try {
    visible.mesh = geometry::visible_surface(shape.mesh);
  } catch (const InputError& error) {
    throw InputError(shape.file, error.place(), error.problem());
  }
  return visible;
}

/// Figures of lint on the prediction alone: no truth is needed for them.
void add_soundness(const io::RiggedShape& predicted, const PairSettings& settings, PairResult& result) {
  lint::LintOptions options;
  options.seed = settings.seed;
  const Json figures = lint::lint_rig(io::to_asset(predicted), options).figures;
  const std::pair<const char*, const char*> keys[] = {
      {"sound_stretched", "stretched_share"},   {"sound_inverted", "inverted_share"},
      {"sound_crossed", "newly_crossed_share"}, {"sound_bleed", "shell_bleed_share"},
      {"sound_islands", "far_weight_islands"},  {"sound_dead_joints", "dead_joints"},
      {"sound_inside", "joints_inside_share"},  {"sound_gap_mean", "gap_growth_mean"},
      {"sound_gap_max", "gap_growth_max"}};
  for (const auto& [key, figure] : keys) {
    if (figures.contains(figure))
      result.set(key, figures.at(figure).get<double>());
    else
      result.skip(key, "lint could not look for it: the rig is broken");
  }
}

/// True when the prediction most resembles a reference of its truth's category.
void add_category(const ComparedShapes& shapes, const CategoryQuestion& question, PairResult& result) {
  if (question.references == nullptr)
    return result.skip("category", "no --category-split given, or none of its shapes has a category");
  if (question.expected.empty())
    return result.skip("category", "the ground truth's data set does not say what kind it is");
  const CategoryReferences::Match match = question.references->nearest(shapes.predicted.mesh, question.truth_id);
  result.set("category", match.category == question.expected ? 1.0 : 0.0);
  result.details["category"] = {
      {"expected", question.expected}, {"nearest", match.id}, {"is", match.category}, {"chamfer", match.chamfer}};
}

void add_image_metrics(const ComparedShapes& shapes, const PairSettings& settings,
                       const metrics::PerceptualDistances& perceptual, PairResult& result) {
  if (has_colors(shapes.predicted) != has_colors(shapes.truth))
    return skip_group("image", "only one side has colours, so colour renders do not compare", result);
  metrics::ViewOptions options;
  options.size = settings.image_size;
  const metrics::ImageScores scores =
      metrics::image_scores(metrics::render_views(shapes.predicted, metrics::Similarity(), options),
                            metrics::render_views(shapes.truth, metrics::Similarity(), options), perceptual);
  result.set("psnr", scores.psnr);
  result.set("ssim", scores.ssim);
  if (scores.lpips)
    result.set("lpips", *scores.lpips);
  else
    result.skip("lpips", "no weights given");
  if (scores.encoder)
    result.set("encoder_distance", *scores.encoder);
  else
    result.skip("encoder_distance", "no image encoder given");
}

}  // namespace

TransportMethod parse_transport(const std::string& word) {
  return value_of<TransportMethod>({{TransportMethod::kExact, "exact"}, {TransportMethod::kSinkhorn, "sinkhorn"}}, word,
                                   "--transport");
}

Json to_json(const PairSettings& settings) {
  return {{"normalization", metrics::to_string(settings.alignment.normalization)},
          {"icp", settings.alignment.icp ? to_json(settings.alignment.registration) : Json(nullptr)},
          {"seed", settings.seed},
          {"surface_samples", settings.surface_samples},
          {"visible_surface", settings.visible_surface},
          {"clip_joints", settings.clip_joints},
          {"merge_joints", settings.merge_joints},
          {"image_size", settings.image_size},
          {"poses", settings.poses},
          {"motion_frames", settings.motion_frames},
          {"transport", transport_json(settings)},
          {"groups", settings.groups},
          {"lpips", settings.lpips},
          {"image_encoder", settings.image_encoder},
          {"categories", settings.categories},
          {"motion", settings.motion}};
}

void check(const PairSettings& settings) {
  check(settings.alignment.registration);
  static const std::set<std::string> kGroups = [] {
    std::set<std::string> groups = PairSettings().groups;
    groups.insert("soundness");
    return groups;
  }();
  for (const std::string& group : settings.groups) {
    if (kGroups.count(group) > 0) continue;
    throw InputError("", group, "no such group of metrics; there are " + joined(kGroups));
  }
  if (settings.groups.empty()) throw InputError("", "", "no group of metrics to compute");
  const bool sinkhorn = settings.transport == TransportMethod::kSinkhorn;
  if (settings.epsilon && !sinkhorn)
    throw InputError("", "--sinkhorn-epsilon", "is that of Sinkhorn's iterations: it goes with --transport sinkhorn");
  if (settings.epsilon && !(*settings.epsilon > 0.0 && *settings.epsilon <= 1.0))
    throw InputError("", "--sinkhorn-epsilon", "is a share of the largest squared distance: above 0, at most 1");
  if (sinkhorn && !settings.wants("transport"))
    throw InputError("", "--transport", "is about the metrics of the group 'transport', which --metrics leaves out");
  require_between(static_cast<double>(settings.surface_samples), 1, 10'000'000, "surface samples");
  require_between(settings.merge_joints, 0, 0.5, "distance of joints to merge");
  require_between(settings.image_size, 16, 4096, "image size");
  require_between(settings.poses, 1, 10000, "poses");
  require_between(settings.motion_frames, 1, 10000, "frames of a motion");
}

void PairResult::set(const std::string& key, double value) {
  if (std::isfinite(value))
    values[key] = value;
  else
    skip(key, "the result is not finite");
}

double PairResult::value(const std::string& key) const {
  const auto found = values.find(key);
  return found == values.end() ? std::numeric_limits<double>::quiet_NaN() : found->second;
}

Json to_json(const PairResult& result) {
  Json json = {{"id", result.id}};
  if (!result.failure.empty()) json["failure"] = result.failure;
  json["values"] = result.values;
  json["not_computed"] = result.not_computed;
  json["notes"] = result.notes;
  json["details"] = result.details;
  json["commit"] = result.commit;
  return json;
}

PairResult pair_result_from_json(const Json& json, const std::string& file) {
  try {
    PairResult result;
    result.id = json.at("id").get<std::string>();
    result.failure = json.value("failure", "");
    result.values = json.at("values").get<std::map<std::string, double>>();
    result.not_computed = json.at("not_computed").get<std::map<std::string, std::string>>();
    result.notes = json.at("notes").get<std::vector<std::string>>();
    result.details = json.at("details");
    result.commit = json.value("commit", "");
    return result;
  } catch (const Json::exception& error) {
    throw InputError(file, "", std::string("not a saved evaluation of a pair: ") + error.what());
  }
}

namespace {

/// True for a rig without a mesh that was made for the truth's: its weights are for as many vertices, or everything is
/// compared in the truth's frame, which is that of a given mesh.
bool is_for_given_mesh(const io::RiggedShape& predicted, const io::RiggedShape& truth, const PairSettings& settings) {
  if (!predicted.mesh.vertices.empty() || !predicted.has_joints() || truth.mesh.vertices.empty()) return false;
  using Mode = metrics::NormalizationMode;
  const Mode mode = settings.alignment.normalization;
  return predicted.skin.rows() == truth.mesh.vertices.size() || mode == Mode::kTruth || mode == Mode::kTruthWithJoints;
}

io::RiggedShape on_given_mesh(const io::RiggedShape& predicted, const io::RiggedShape& truth) {
  io::RiggedShape shape = predicted;
  shape.mesh.vertices = truth.mesh.vertices;
  shape.mesh.faces = truth.mesh.faces;
  shape.notes.emplace_back("it has no mesh, and is taken for a rig of the ground truth's");
  if (shape.skin.rows() > 0 && !shape.has_skin()) {
    shape.notes.push_back("its weights for " + std::to_string(shape.skin.rows()) + " vertices are of another mesh");
    shape.skin = {};
  }
  return shape;
}

}  // namespace

ComparedShapes bring_together(const io::RiggedShape& predicted, const io::RiggedShape& truth,
                              const PairSettings& settings) {
  if (is_for_given_mesh(predicted, truth, settings))
    return bring_together(on_given_mesh(predicted, truth), truth, settings);
  metrics::AlignmentOptions options = settings.alignment;
  options.registration.seed = settings.seed;
  ComparedShapes shapes;
  if (settings.visible_surface) {
    const io::RiggedShape seen_of_prediction = visible_part(predicted), seen_of_truth = visible_part(truth);
    shapes.alignment = metrics::align(seen_of_prediction, seen_of_truth, options);
    if (truth.has_surface() && predicted.has_surface()) {
      shapes.visible_predicted = metrics::transformed(shapes.alignment.prediction, seen_of_prediction).mesh;
      shapes.visible_truth = metrics::transformed(shapes.alignment.truth, seen_of_truth).mesh;
    }
  } else {
    shapes.alignment = metrics::align(predicted, truth, options);
  }
  shapes.predicted = metrics::transformed(shapes.alignment.prediction, predicted);
  shapes.truth = metrics::transformed(shapes.alignment.truth, truth);
  if (shapes.alignment.by == metrics::AlignedBy::kJoints && !truth.mesh.vertices.empty())
    shapes.predicted.notes.emplace_back("it has no mesh: its joints stand for it, which are also what is scored");
  if (settings.clip_joints)
    for (Eigen::Vector3d& joint : shapes.truth.joints.positions)
      joint = joint.cwiseMax(-0.5).cwiseMin(0.5).cast<Eigen::half>().cast<double>();
  if (settings.merge_joints > 0.0) {
    for (io::RiggedShape* shape : {&shapes.predicted, &shapes.truth}) {
      if (const std::size_t merged = merge_joints(*shape, settings.merge_joints); merged > 0)
        shape->notes.push_back(std::to_string(merged) + " joints merged into others within " +
                               significant(settings.merge_joints, 3));
    }
  }
  return shapes;
}

PairResult evaluate_pair(const io::RiggedShape& predicted, const io::RiggedShape& truth, const PairSettings& settings,
                         const metrics::PerceptualDistances& perceptual, const CategoryQuestion& category,
                         const metrics::Motion* motion) {
  const auto started = std::chrono::steady_clock::now();
  PairResult result;
  result.id = truth.id;
  const ComparedShapes shapes = bring_together(predicted, truth, settings);
  copy_notes(shapes.truth, "ground truth", result);
  copy_notes(shapes.predicted, "prediction", result);
  result.details["alignment"] = alignment_json(shapes.alignment);
  result.details["prediction"] = sizes(predicted);
  result.details["ground_truth"] = sizes(truth);
  if (truth.has_joints()) result.details["skeleton"] = tree_signature(truth.joints.parents);
  if (shapes.alignment.icp_used)
    result.set("icp_rmse", shapes.alignment.icp.rmse);
  else
    result.skip("icp_rmse", settings.alignment.icp ? "no registration was needed" : "registration was switched off");

  const std::string no_joints = missing_joints(shapes), no_surface = missing_surface(shapes);
  const auto group = [&](const char* name, const std::string& missing, const std::function<void()>& add) {
    if (settings.wants(name)) add_group(name, missing, add, result);
  };
  group("skeleton", no_joints, [&] { add_skeleton_metrics(shapes, result); });
  group("transport", no_joints, [&] { add_transport_metrics(shapes, settings, result); });
  group("anymate", no_joints, [&] { add_anymate_metrics(shapes, result); });
  group("skin", missing_skin(shapes), [&] {
    add_skin_metrics(shapes, metrics::matching_plan(shapes.predicted.joints, shapes.truth.joints), settings, result);
  });
  group("motion", missing_to_move(shapes), [&] { add_motion_metrics(shapes, settings, motion, result); });
  group("surface", no_surface, [&] {
    add_surface_metrics(shapes, settings, result);
    add_category(shapes, category, result);
  });
  const std::string no_skin = missing_skin(shapes.predicted, "the prediction");
  group("soundness", no_skin.empty() && !shapes.predicted.has_surface() ? "the prediction has no faces" : no_skin,
        [&] { add_soundness(shapes.predicted, settings, result); });
  group("image", no_surface, [&] { add_image_metrics(shapes, settings, perceptual, result); });
  result.set("seconds", std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count());
  return result;
}

MovedPair same_motion(const ComparedShapes& shapes, const PairSettings& settings, const metrics::Motion* given) {
  MovedPair moved;
  moved.truth =
      metrics::truth_motion(shapes.truth, shapes.alignment.truth, given, settings.seed, settings.motion_frames);
  moved.predicted = metrics::retarget(moved.truth, shapes.predicted.joints);
  return moved;
}

}  // namespace anigen::eval
