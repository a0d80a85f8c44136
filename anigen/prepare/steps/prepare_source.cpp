#include "anigen/prepare/steps/prepare_source.h"

#include <chrono>
#include <optional>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/version.h"
#include "anigen/prepare/augment/pose_augmentation.h"
#include "anigen/prepare/import_asset.h"
#include "anigen/prepare/steps/import_columns.h"
#include "anigen/prepare/steps/peak_memory.h"

namespace anigen::prepare {
namespace {

/// Raised whenever the same source would give another asset or other numbers.
constexpr int kImportVersion = 1;

/// Runs work and puts into `failure` what was wrong with the asset, if anything was. @return whether it succeeded
/// @throws as failure_of_item(), for what is no asset's fault
bool try_work(const std::string& name, const std::function<void()>& work, StepFailure& failure) {
  try {
    work();
    return true;
  } catch (const CleanedOut& error) {
    failure.reason = error.what();
    failure.rule = error.finding().rule;
  } catch (const InputError& error) {
    failure.reason = error.what();
  } catch (...) {
    failure.reason = name + ": " + failure_of_item();
  }
  return false;
}

class Stopwatch {
 public:
  Stopwatch() { reset_peak_memory(); }
  StepTiming read(const std::string& step) const {
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
    return {step, seconds, peak_memory_bytes()};
  }

 private:
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

/// Ids of other datasets are whatever their tables say; ours name files.
bool is_safe_id(const std::string& id) {
  return !id.empty() && id.size() <= 200 && id.front() != '.' && id.find('/') == std::string::npos &&
         id.find('\\') == std::string::npos && id.find('\0') == std::string::npos;
}

const StepFailure* find_known(const SourceTask& task, const StepBegin& at) {
  for (const StepFailure& failure : task.known) {
    if (failure.id == at.id && failure.step == at.step && failure.fingerprint == at.fingerprint) return &failure;
  }
  return nullptr;
}

}  // namespace

/// The first step of an asset, which everything else depends on.
struct SourcePreparer::Root {
  std::size_t variant = 0;
  Json options;
  std::function<Json()> columns;  ///< makes the asset available to the job and returns what was measured
};

SourcePreparer::SourcePreparer(std::filesystem::path out, StepPlan plan,
                               std::shared_ptr<const FeatureExtractor> extractor)
    : out_(std::move(out)), plan_(std::move(plan)), steps_(planned_steps(plan_, std::move(extractor))) {}

AssetOutcome SourcePreparer::prepare_asset(const Root& root, AssetJob& job, const SourceTask& task,
                                           const StepObserver& observe) const {
  AssetOutcome outcome;
  outcome.id = job.id();
  outcome.variant = root.variant;
  StepRecords records = read_step_records(job.places().record());
  bool unsaved = false, made = false;
  const auto save = [&] {
    write_step_records(job.places().record(), job.id(), records);
    unsaved = false;
  };
  // Does one step unless it failed before in the same way; true when it is done.
  const auto attempt = [&](const std::string& name, const std::string& fingerprint, const std::function<void()>& work) {
    const StepBegin at{job.id(), root.variant, name, fingerprint};
    if (const StepFailure* known = find_known(task, at)) {
      outcome.failures.push_back(*known);
      return false;
    }
    observe(at);
    made = true;
    const Stopwatch watch;
    StepFailure failure{job.id(), root.variant, name, fingerprint, "", ""};
    const bool done = try_work(task.source.file_identifier, work, failure);
    outcome.timings.push_back(watch.read(name));
    if (!done) outcome.failures.push_back(std::move(failure));
    return done;
  };

  const std::string root_fingerprint = records.fingerprint(kImport, kImportVersion, root.options, {});
  if (!records.has(kImport) || records.steps.at(kImport).fingerprint != root_fingerprint ||
      !readable(records.columns(kImport))) {
    StepResult result{root_fingerprint, kImportVersion, root.options, {}, 0, 0, Json::object(), commit()};
    const std::string name = root.variant == 0 ? kImport : "augment";
    if (!attempt(name, root_fingerprint, [&] { result.columns = root.columns(); })) return outcome;
    records.steps[kImport] = std::move(result);
    records.drop_stale();
    unsaved = true;  // saved with the first step that follows: alone it saves nothing worth an fsync
  }
  outcome.imported = true;
  outcome.rejected_pose = is_rejected_pose(records.columns(kImport));
  if (!outcome.rejected_pose) job.set_normalisation(normalisation_of(records.columns(kImport)));
  for (const PlannedStep& planned : steps_) {
    if (outcome.rejected_pose) break;
    const Step& step = *planned.step;
    bool possible = true;
    for (const std::string& input : step.inputs()) possible = possible && records.has(input);
    if (!possible || up_to_date(step, job.places(), records, !planned.asked)) continue;
    StepResult result;
    result.version = step.version();
    result.commit = commit();
    result.options = step.options();
    result.inputs = step.inputs();
    result.fingerprint = records.fingerprint(step.name(), result.version, result.options, result.inputs);
    if (records.steps.erase(step.name()) > 0) {
      // Whatever is half-replaced after a kill must not pass for done.
      records.drop_stale();
      save();
    }
    const bool done = attempt(step.name(), result.fingerprint, [&] {
      step.clear(job.places());
      result.columns = step.run(job);
      if (!measure_files(step.outputs(job.places(), result.options), result))
        throw Error(step.name() + " left out a file");
    });
    if (!done) continue;
    records.steps[step.name()] = std::move(result);
    save();
  }
  records.drop_stale();
  if (unsaved) save();
  outcome.reused = !made;
  return outcome;
}

SourceOutcome SourcePreparer::prepare(const SourceTask& task, const StepObserver& observe) const {
  SourceOutcome outcome;
  outcome.number = task.number;
  std::string id = task.id;
  StepFailure unreadable{"", 0, kImport, "", "", ""};
  if (id.empty() && !try_work(
                        task.source.file_identifier, [&] { id = asset_id(task.source, reader_); }, unreadable)) {
    AssetOutcome failed;
    failed.failures.push_back(std::move(unreadable));
    outcome.assets.push_back(std::move(failed));
    return outcome;
  }
  if (!is_safe_id(id)) {
    AssetOutcome failed;
    failed.failures.push_back({"", 0, kImport, "", task.source.file_identifier + ": its id cannot name a file", ""});
    outcome.assets.push_back(std::move(failed));
    return outcome;
  }
  if (task.only_identify) {
    outcome.assets.emplace_back();
    outcome.assets[0].id = id;
    return outcome;
  }

  std::optional<PreparedAsset> prepared;
  const auto import = [&]() -> PreparedAsset& {
    if (!prepared) prepared = import_asset(task.source, plan_.cleaning, reader_);
    return *prepared;
  };
  // The asset moves into the job, which keeps it for the steps and for the variants.
  AssetJob job({out_, id}, [&] { return std::move(import().asset); });
  Root root;
  root.options = {{"source", id}, {"cleaning", to_json(plan_.cleaning)}};
  if (!task.source.procedural() && task.source.format == io::RigFormat::kDataset) {
    // Assets of a dataset keep their ids, which say nothing about the content.
    try_work(
        task.source.file_identifier, [&] { root.options["content"] = reader_.content_id(task.source.rig()); },
        unreadable);
  }
  root.columns = [&] { return import_columns(import().record); };
  outcome.assets.push_back(prepare_asset(root, job, task, observe));
  if (!outcome.assets[0].imported) return outcome;

  std::optional<PoseAugmenter> augmenter;
  for (std::size_t k = 0; k < plan_.variants; ++k) {
    std::optional<Asset> posed;
    Json columns;
    const auto pose = [&] {
      if (!columns.is_null()) return;
      if (!augmenter) augmenter.emplace(job.asset(), id, plan_.seed, plan_.poses);
      Provenance provenance;
      posed = augmenter->variant(k, provenance);
      const StepRecords records = read_step_records(job.places().record());
      columns = variant_columns(records.columns(kImport), posed ? &*posed : nullptr, provenance);
    };
    AssetJob variant({out_, variant_id(id, plan_.seed, k, plan_.poses)}, [&] {
      pose();
      return std::move(posed).value();
    });
    Root variant_root;
    variant_root.variant = variant_number(k);
    variant_root.options = {
        {"source", root.options}, {"seed", plan_.seed}, {"variant", k}, {"poses", to_json(plan_.poses)}};
    variant_root.columns = [&] {
      pose();
      return columns;
    };
    outcome.assets.push_back(prepare_asset(variant_root, variant, task, observe));
  }
  return outcome;
}

}  // namespace anigen::prepare
