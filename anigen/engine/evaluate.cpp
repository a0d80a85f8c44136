#include "anigen/engine/evaluate.h"

#include "anigen/core/error.h"
#include "anigen/core/process.h"
#include "anigen/engine/evaluate_request.h"
#include "anigen/engine/module.h"
#include "anigen/engine/option_names.h"
#include "anigen/eval/lint_files.h"
#include "anigen/eval/pair.h"
#include "anigen/lint/lint.h"
#include "anigen/metrics/chamfer.h"
#include "anigen/metrics/skeleton_transport.h"

namespace anigen::engine {

namespace {

io::RiggedShape shape_of(const Asset& asset, const char* whose) {
  return io::rigged_shape(asset, whose, asset.name.empty() ? whose : asset.name);
}

constexpr OptionName kScoreNames[] = {{"--protocol", "protocol"}};

/// @throws InputError for an unknown word or a number out of range
eval::PairSettings checked_settings(const EvaluateOptions& options) {
  return with_library_words(kScoreNames, [&] {
    eval::PairSettings settings = pair_settings(options);
    eval::check(settings);
    return settings;
  });
}

}  // namespace

Scores evaluate(const Asset& predicted, const Asset& truth, const EvaluateOptions& options, Job* job) {
  quiet_log();
  const JobScope scope(job);
  throw_if_interrupted();
  if (job != nullptr) job->report("evaluating", 0.0);
  const eval::PairResult result =
      eval::evaluate_pair(shape_of(predicted, "prediction"), shape_of(truth, "truth"), checked_settings(options));
  throw_if_interrupted();
  if (job != nullptr) job->report("evaluating", 1.0);
  if (!result.failure.empty()) throw InputError("", "", result.failure);
  return {result.values, result.not_computed, result.notes};
}

double gromov_wasserstein(const JointTree& predicted, const JointTree& truth) {
  return metrics::skeleton_transport({predicted, "prediction"}, {truth, "truth"}).gromov_wasserstein;
}

namespace {

std::vector<Finding> findings_of(const anigen::lint::RigLint& lint) {
  std::vector<Finding> findings;
  for (const anigen::lint::LintFinding& found : lint.findings) {
    findings.push_back({found.code, anigen::lint::to_string(found.severity), found.sentence, found.count, found.share,
                        found.place.kind, found.place.index});
  }
  return findings;
}

}  // namespace

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
  std::vector<Finding> findings = findings_of(anigen::lint::lint_rig(asset));
  throw_if_interrupted();
  return findings;
}

std::vector<Finding> lint_file(const std::filesystem::path& file, Job* job) {
  quiet_log();
  const JobScope scope(job);
  const std::vector<eval::LintedFile> linted = eval::lint_path(file);
  if (linted.size() != 1)
    throw InputError(file.string(), "", "holds " + std::to_string(linted.size()) + " rigs; name one");
  if (!linted.front().rejection.empty()) throw InputError("", "", linted.front().rejection);
  return findings_of(linted.front().lint);
}

}  // namespace anigen::engine
