#include "anigen/engine/evaluate.h"

#include "anigen/core/error.h"
#include "anigen/core/process.h"
#include "anigen/engine/module.h"
#include "anigen/eval/pair.h"
#include "anigen/eval/protocol.h"
#include "anigen/lint/lint.h"
#include "anigen/metrics/chamfer.h"
#include "anigen/metrics/skeleton_transport.h"

namespace anigen::engine {

namespace {

io::RiggedShape shape_of(const Asset& asset, const char* whose) {
  return io::rigged_shape(asset, whose, asset.name.empty() ? whose : asset.name);
}

eval::PairSettings settings_of(const EvaluateOptions& options) {
  eval::PairSettings settings;
  settings.seed = options.seed;
  settings.alignment.icp = options.registration;
  settings.merge_joints = options.merge_joints;
  settings.visible_surface = options.visible_surface;
  settings.surface_samples = options.surface_samples;
  if (!options.normalization.empty())
    settings.alignment.normalization = metrics::normalization_mode(options.normalization);
  if (!options.groups.empty()) settings.groups = {options.groups.begin(), options.groups.end()};
  if (!options.protocol.empty()) eval::apply(eval::evaluation_protocol(options.protocol), settings);
  eval::check(settings);
  return settings;
}

}  // namespace

Scores evaluate(const Asset& predicted, const Asset& truth, const EvaluateOptions& options, Job* job) {
  quiet_log();
  const JobScope scope(job);
  throw_if_interrupted();
  if (job != nullptr) job->report("evaluating", 0.0);
  const eval::PairResult result =
      eval::evaluate_pair(shape_of(predicted, "prediction"), shape_of(truth, "truth"), settings_of(options));
  throw_if_interrupted();
  if (job != nullptr) job->report("evaluating", 1.0);
  if (!result.failure.empty()) throw InputError("", "", result.failure);
  return {result.values, result.not_computed, result.notes};
}

double gromov_wasserstein(const JointTree& predicted, const JointTree& truth) {
  return metrics::skeleton_transport({predicted, "prediction"}, {truth, "truth"}).gromov_wasserstein;
}

double wasserstein(const JointTree& predicted, const JointTree& truth) {
  return metrics::skeleton_transport({predicted, "prediction"}, {truth, "truth"}).wasserstein;
}

Chamfer chamfer(const JointTree& predicted, const JointTree& truth) {
  const metrics::SkeletonChamfer distances =
      metrics::skeleton_chamfer({predicted, "prediction"}, {truth, "truth"}, metrics::SkeletonProtocol::kPaper);
  return {distances.j2j, distances.j2b, distances.b2b};
}

std::vector<Finding> lint(const Asset& asset, Job* job) {
  quiet_log();
  const JobScope scope(job);
  throw_if_interrupted();
  std::vector<Finding> findings;
  for (const anigen::lint::LintFinding& found : anigen::lint::lint_rig(asset).findings) {
    findings.push_back({found.code, anigen::lint::to_string(found.severity), found.sentence, found.count, found.share,
                        found.place.kind, found.place.index});
  }
  throw_if_interrupted();
  return findings;
}

}  // namespace anigen::engine
