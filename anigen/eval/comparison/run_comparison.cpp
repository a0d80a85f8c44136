#include "anigen/eval/comparison/run_comparison.h"

#include <algorithm>
#include <exception>
#include <map>
#include <optional>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/json.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/progress.h"
#include "anigen/core/random.h"
#include "anigen/core/shared_work.h"
#include "anigen/core/version.h"
#include "anigen/eval/comparison/file_name.h"
#include "anigen/eval/pair/fingerprint.h"
#include "anigen/eval/pair/pair_evaluation.h"

namespace anigen::eval {
namespace {

namespace fs = std::filesystem;

constexpr const char* kLeases = ".leases";

/// What a saved result is valid for.
std::string stamp(const PairSettings& settings, const CategoryQuestion& category, const io::RiggedShape& predicted,
                  const io::RiggedShape& truth) {
  const std::string asked = category.references == nullptr ? "" : "\n" + category.expected + "\n" + category.truth_id;
  const std::uint64_t hash = stable_hash(to_json(settings).dump() + kVersion + asked, fingerprint(predicted));
  return std::to_string(hash) + "-" + std::to_string(fingerprint(truth));
}

bool load(const fs::path& path, const std::string& wanted, bool accept_other_code, PairResult& result) {
  std::error_code ignored;
  if (!fs::exists(path, ignored)) return false;
  try {
    const Json json = read_json(path);
    if (json.value("stamp", "") != wanted) return false;
    PairResult found = pair_result_from_json(json, path.string());
    if (found.commit != commit() && !accept_other_code) return false;
    result = std::move(found);
    return true;
  } catch (const InputError& error) {
    log::warn("{}: computed again", error.what());
    return false;
  }
}

fs::path saved_file(const ComparisonRun& run, const std::string& label, const std::string& id) {
  return run.cache / file_name(label) / (file_name(id) + ".json");
}

/// Says once which saved results another build of the program made, and that they do not count.
void tell_of_other_code(const std::vector<ComparedMethod>& methods, const ComparisonRun& run) {
  if (!run.resume || run.accept_other_code) return;
  std::size_t count = 0;
  std::string by;
  for (const ComparedMethod& method : methods) {
    for (const PairPlan& pair : method.pairs) {
      const fs::path file = saved_file(run, method.label, pair.id);
      std::error_code ignored;
      if (!fs::exists(file, ignored)) continue;
      try {
        const std::string found = read_json(file).value("commit", "");
        if (found == commit()) continue;
        if (count++ == 0) by = found;
      } catch (const std::exception&) {  // damaged: said when the pair's turn comes
      }
    }
  }
  if (count == 0) return;
  log::warn("{} saved results of pairs were made by {}; {} computes them again (--accept-other-code keeps them)", count,
            named_commit(by), named_commit(commit()));
}

PairResult evaluate(const PairPlan& pair, const ComparedMethod& method, const ComparisonRun& run) {
  PairResult result;
  try {
    if (!pair.prediction_id) throw InputError("", "", pair.missing_reason);
    const io::RiggedShape truth = method.truths->read(pair.truth_id);
    const io::RiggedShape predicted = method.predictions->read(*pair.prediction_id);
    CategoryQuestion category;
    if (run.categories != nullptr) category = {run.categories, method.truths->category(pair.truth_id), pair.truth_id};
    const std::string wanted = stamp(run.settings, category, predicted, truth);
    const fs::path saved = saved_file(run, method.label, pair.id);
    if (run.resume && load(saved, wanted, run.accept_other_code, result)) {
      result.id = pair.id;
      return result;
    }
    result = evaluate_pair(predicted, truth, run.settings, run.perceptual, category, run.motion);
    result.id = pair.id;
    result.commit = commit();
    Json json = to_json(result);
    json["stamp"] = wanted;
    write_file_atomically(saved, json.dump(1) + "\n");
  } catch (...) {
    result = {};
    result.failure = failure_of_item();
  }
  result.id = pair.id;
  return result;
}

}  // namespace

Comparison run_comparison(const std::vector<ComparedMethod>& methods, const ComparisonRun& run) {
  if (methods.empty() || methods[0].pairs.empty()) throw InputError("", "", "there is not one pair to evaluate");
  if (static_cast<bool>(run.perceptual) == run.settings.lpips.is_null())
    throw Error("a perceptual distance and its description belong together: saved results are told apart by it");
  if ((run.categories == nullptr) != run.settings.categories.is_null())
    throw Error("references of categories and their description belong together: saved results are told apart by it");
  if ((run.motion == nullptr) != run.settings.motion.is_null())
    throw Error("a motion and its description belong together: saved results are told apart by it");
  tell_of_other_code(methods, run);
  Comparison comparison;
  comparison.seed = run.settings.seed;
  for (const PairPlan& pair : methods[0].pairs) comparison.ids.push_back(pair.id);

  struct Work {
    std::size_t method, row;
    const PairPlan* pair;
  };
  std::vector<Work> work;
  for (std::size_t m = 0; m < methods.size(); ++m) {
    comparison.methods.push_back(methods[m].label);
    comparison.results.emplace_back(comparison.ids.size());
    std::map<std::string, const PairPlan*> by_id;
    for (const PairPlan& pair : methods[m].pairs) by_id[pair.id] = &pair;
    for (std::size_t i = 0; i < comparison.ids.size(); ++i) {
      const auto found = by_id.find(comparison.ids[i]);
      if (found == by_id.end()) {
        comparison.results[m][i].id = comparison.ids[i];
        comparison.results[m][i].failure = "its list of pairs has no " + comparison.ids[i];
        continue;
      }
      work.push_back({m, i, found->second});
    }
  }
  // Pairs of one ground truth run one after the other, so that its file is still in the disk cache.
  std::stable_sort(work.begin(), work.end(), [](const Work& a, const Work& b) { return a.row < b.row; });

  std::vector<std::string> names;
  for (const Work& item : work) names.push_back(methods[item.method].label + "/" + item.pair->id);
  const LeaseFolder leases(run.cache / kLeases);
  Progress progress("evaluating", work.size(), "pairs");
  // Whether a pair was done elsewhere shows when its shapes are read, which is for its turn; none counts as done here.
  work_together(
      leases, names, [](std::size_t) { return false; },
      [&](const std::vector<std::size_t>& pieces, const Claim& claim) {
        parallel_for(pieces.size(), [&](std::size_t p) {
          if (interrupt_requested()) return;
          const std::optional<Lease> lease = claim(pieces[p]);
          if (!lease) return;
          const Work& item = work[pieces[p]];
          comparison.results[item.method][item.row] = evaluate(*item.pair, methods[item.method], run);
          progress.advance();
        });
      });
  progress.finish();
  throw_if_interrupted();
  leases.remove_left();
  return comparison;
}

}  // namespace anigen::eval
