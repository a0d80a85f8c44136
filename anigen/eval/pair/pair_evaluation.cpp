#include "anigen/eval/pair/pair_evaluation.h"

#include <chrono>
#include <functional>

#include "anigen/core/error.h"
#include "anigen/eval/pair/metric_table.h"
#include "anigen/eval/pair/pair_groups.h"
#include "anigen/eval/skeleton/joint_ties.h"

namespace anigen::eval {
namespace {

Json to_json(const Similarity& similarity) {
  Json rows = Json::array();
  const Eigen::Matrix4d matrix = similarity.matrix();
  for (int row = 0; row < 4; ++row) rows.push_back({matrix(row, 0), matrix(row, 1), matrix(row, 2), matrix(row, 3)});
  return rows;
}

Json to_json(const Alignment& alignment) {
  Json json = {{"by", to_string(alignment.by)},
               {"prediction_to_frame", to_json(alignment.prediction)},
               {"truth_to_frame", to_json(alignment.truth)}};
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

/// What keeps a group from being computed, or nothing.
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

}  // namespace

void skip_group(const std::string& group, const std::string& reason, PairResult& result) {
  for (const MetricInfo& metric : metric_table()) {
    if (metric.group == group && result.values.count(metric.key) == 0) result.skip(metric.key, reason);
  }
}

ComparedShapes bring_together(const io::RiggedShape& predicted, const io::RiggedShape& truth,
                              const PairSettings& settings) {
  AlignmentOptions options = settings.alignment;
  options.registration.seed = settings.seed;
  ComparedShapes shapes;
  shapes.alignment = align(predicted, truth, options);
  shapes.predicted = transformed(shapes.alignment.prediction, predicted);
  shapes.truth = transformed(shapes.alignment.truth, truth);
  return shapes;
}

PairResult evaluate_pair(const io::RiggedShape& predicted, const io::RiggedShape& truth, const PairSettings& settings,
                         const PerceptualDistance& perceptual, const CategoryQuestion& category, const Motion* motion) {
  const auto started = std::chrono::steady_clock::now();
  PairResult result;
  result.id = truth.id;
  copy_notes(truth, "ground truth", result);
  copy_notes(predicted, "prediction", result);
  const ComparedShapes shapes = bring_together(predicted, truth, settings);
  result.details["alignment"] = to_json(shapes.alignment);
  result.details["prediction"] = sizes(predicted);
  result.details["ground_truth"] = sizes(truth);
  if (shapes.alignment.icp_used)
    result.set("icp_rmse", shapes.alignment.icp.rmse);
  else
    result.skip("icp_rmse", settings.alignment.icp ? "no registration was needed" : "registration was switched off");

  const std::string no_joints = missing_joints(shapes), no_surface = missing_surface(shapes);
  if (settings.wants("skeleton"))
    add_group(
        "skeleton", no_joints, [&] { add_skeleton_metrics(shapes, result); }, result);
  if (settings.wants("transport"))
    add_group(
        "transport", no_joints, [&] { add_transport_metrics(shapes, settings, result); }, result);
  if (settings.wants("anymate"))
    add_group(
        "anymate", no_joints, [&] { add_anymate_metrics(shapes, result); }, result);
  if (settings.wants("skin")) {
    add_group(
        "skin", missing_skin(shapes),
        [&] {
          const Eigen::MatrixXd plan = matching_plan(shapes.predicted.joints, shapes.truth.joints);
          add_skin_metrics(shapes, plan, settings, result);
        },
        result);
  }
  if (settings.wants("motion"))
    add_group(
        "motion", missing_to_move(shapes), [&] { add_motion_metrics(shapes, settings, motion, result); }, result);
  if (settings.wants("surface"))
    add_group(
        "surface", no_surface,
        [&] {
          add_surface_metrics(shapes, settings, result);
          add_category(shapes, category, result);
        },
        result);
  if (settings.wants("image"))
    add_group(
        "image", no_surface, [&] { add_image_metrics(shapes, settings, perceptual, result); }, result);
  result.set("seconds", std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count());
  return result;
}

}  // namespace anigen::eval
