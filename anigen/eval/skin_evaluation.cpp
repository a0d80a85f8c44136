#include "anigen/eval/skin_evaluation.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/progress.h"
#include "anigen/eval/inputs/pairs.h"
#include "anigen/io/npz.h"
#include "anigen/io/rigs/dataset_source.h"
#include "anigen/io/rigs/file_list.h"

namespace anigen::eval {
namespace {

namespace fs = std::filesystem;

MethodResult run_method(const SkinMethod& method, const io::DatasetItem& item, const GroundTruth& truth) {
  MethodResult result;
  try {
    std::vector<float> predicted = method.predict(item, truth);
    if (predicted.size() != truth.skin.size()) {
      throw Error("has " + std::to_string(predicted.size()) + " weights, expected " +
                  std::to_string(truth.skin.size()));
    }
    normalize_rows(predicted, truth.vertex_count(), truth.joint_count(), method.label);
    result.scores = score_skin(predicted, truth.skin, truth.vertex_count(), truth.joint_count());
  } catch (...) {
    result.failure = failure_of_item();
  }
  return result;
}

/// Vertices that the ground truth does not bind count like all others, for joint 0: whoever reads the scores must know.
void tell_of_unweighted(const std::vector<AssetResult>& assets) {
  std::size_t vertices = 0, touched = 0;
  for (const AssetResult& asset : assets) {
    vertices += asset.unweighted;
    touched += asset.unweighted > 0 ? 1 : 0;
  }
  if (vertices == 0) return;
  log::warn("{} vertices of {} assets have no weight in the ground truth: they are evaluated as bound to joint 0",
            vertices, touched);
}

/// The methods that may (or may not) run in parallel on one asset.
void run_methods(const fs::path& dataset, const std::vector<SkinMethod>& methods, bool parallel, AssetResult& asset) {
  try {
    const GroundTruth truth = read_ground_truth(dataset, asset.item.id);
    asset.joints = truth.joint_count();
    asset.vertices = truth.vertex_count();
    asset.unweighted = truth.unweighted;
    for (std::size_t m = 0; m < methods.size(); ++m) {
      if (methods[m].parallel == parallel) asset.methods[m] = run_method(methods[m], asset.item, truth);
    }
  } catch (...) {
    const std::string failure = failure_of_item();
    for (std::size_t m = 0; m < methods.size(); ++m) {
      if (methods[m].parallel == parallel) asset.methods[m].failure = failure;
    }
  }
}

}  // namespace

const std::array<const char*, 3> kScoreNames = {"skin_l1", "skin_l2", "skin_kl"};

std::array<double, 3> score_values(const SkinScore& score) { return {score.l1, score.l2, score.kl}; }

Summary summarize(std::vector<double> values) {
  Summary summary;
  summary.n = values.size();
  if (values.empty()) return summary;
  std::sort(values.begin(), values.end());
  const auto n = static_cast<double>(values.size());
  for (const double value : values) summary.mean += value / n;
  for (const double value : values) summary.std += (value - summary.mean) * (value - summary.mean) / n;
  summary.std = std::sqrt(summary.std);
  const std::size_t middle = values.size() / 2;
  summary.median = values.size() % 2 == 1 ? values[middle] : 0.5 * (values[middle - 1] + values[middle]);
  return summary;
}

SkinEvaluation evaluate_skin(const fs::path& dataset, const std::vector<io::DatasetItem>& items,
                             const std::vector<SkinMethod>& methods, const Json& settings) {
  SkinEvaluation evaluation{methods, {}, settings};
  evaluation.assets.resize(items.size());
  for (std::size_t i = 0; i < items.size(); ++i) {
    evaluation.assets[i].item = items[i];
    evaluation.assets[i].methods.resize(methods.size());
  }
  const bool serial = std::any_of(methods.begin(), methods.end(), [](const SkinMethod& m) { return !m.parallel; });
  Progress progress("evaluate", items.size() * (serial ? 2 : 1), "assets");
  parallel_for(items.size(), [&](std::size_t i) {
    if (interrupt_requested()) return;
    run_methods(dataset, methods, true, evaluation.assets[i]);
    progress.advance();
  });
  for (std::size_t i = 0; serial && i < items.size(); ++i) {
    throw_if_interrupted();
    run_methods(dataset, methods, false, evaluation.assets[i]);
    progress.advance();
  }
  throw_if_interrupted();
  tell_of_unweighted(evaluation.assets);
  return evaluation;
}

SkinMethod predictions_from_folder(const fs::path& folder, const fs::path& dataset,
                                   const std::vector<io::DatasetItem>& items, std::vector<std::string>* unused) {
  if (!fs::is_directory(folder)) throw InputError(folder.string(), "", "no such folder");
  const std::vector<fs::path> files = io::files_below(folder, {".npz"});
  std::map<std::string, fs::path> by_id;
  std::vector<io::FileListSource::Entry> entries = io::entries_below(folder, files);
  for (const io::FileListSource::Entry& entry : entries) by_id[entry.id] = entry.file;
  // Only names are asked for: weights alone are no shape that could be read.
  const io::FileListSource predictions(std::move(entries), nullptr,
                                       std::to_string(files.size()) + " NPZ files in " + folder.string(), false);
  std::vector<std::string> ids;
  for (const io::DatasetItem& item : items) ids.push_back(item.id);
  PairList list = match_pairs(io::DatasetSource(dataset), predictions, ids);
  std::map<std::string, PairPlan> plans;
  for (PairPlan& plan : list.pairs) plans[plan.id] = std::move(plan);
  if (unused != nullptr) *unused = std::move(list.unused);
  SkinMethod method;
  method.key = "prediction";
  method.label = "prediction";
  method.predict = [by_id, plans](const io::DatasetItem& item, const GroundTruth& truth) {
    const PairPlan& plan = plans.at(item.id);
    if (!plan.prediction_id) throw InputError("", "", plan.missing_reason);
    const fs::path& file = by_id.at(*plan.prediction_id);
    const io::NamedArrays arrays = io::read_npz(file, {"skin"});
    const io::NdArray& skin = *io::find(arrays, "skin");
    const std::vector<std::int64_t> wanted = {static_cast<std::int64_t>(truth.vertex_count()),
                                              static_cast<std::int64_t>(truth.joint_count())};
    if (skin.shape != wanted) {
      throw InputError(file.string(), "skin",
                       "expected shape [" + std::to_string(wanted[0]) + ", " + std::to_string(wanted[1]) +
                           "], one row per vertex and one column per joint of the ground truth");
    }
    return skin.as<float>();
  };
  return method;
}

std::array<Summary, 3> summarize(const SkinEvaluation& evaluation, std::size_t method, Group group) {
  std::array<std::vector<double>, 3> values;
  for (const AssetResult& asset : evaluation.assets) {
    const MethodResult& result = asset.methods[method];
    if (!result.failure.empty() || asset.item.usable != (group == Group::kUsable)) continue;
    const auto scores = score_values(result.scores.mean);
    for (std::size_t k = 0; k < 3; ++k) values[k].push_back(scores[k]);
  }
  return {summarize(values[0]), summarize(values[1]), summarize(values[2])};
}

std::array<Summary, 3> summarize_class(const SkinEvaluation& evaluation, std::size_t method, Group group,
                                       std::size_t influence_class) {
  std::array<std::vector<double>, 3> values;
  for (const AssetResult& asset : evaluation.assets) {
    const MethodResult& result = asset.methods[method];
    if (!result.failure.empty() || asset.item.usable != (group == Group::kUsable)) continue;
    if (result.scores.class_sizes[influence_class] == 0) continue;
    const auto scores = score_values(result.scores.by_influences[influence_class]);
    for (std::size_t k = 0; k < 3; ++k) values[k].push_back(scores[k]);
  }
  return {summarize(values[0]), summarize(values[1]), summarize(values[2])};
}

}  // namespace anigen::eval
