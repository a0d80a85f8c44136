#include "anigen/prepare/prepare_source.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <optional>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/version.h"
#include "anigen/creatures/body.h"
#include "anigen/prepare/cleaning.h"
#include "anigen/prepare/pose_augmentation.h"

namespace anigen::prepare {

namespace {

/// Raised whenever the same source would give other files or numbers, so that old outputs are made again.
constexpr int kRecordVersion = 3;

/// Raised whenever the same source would give another asset or other numbers.
constexpr int kImportVersion = 1;

double closest_bones_of(const Skeleton& skeleton) {
  std::vector<Eigen::Vector3f> joints;
  for (const Eigen::Vector3d& p : skeleton.positions()) joints.push_back(p.cast<float>());
  return closest_bones(joints, skeleton.parents);
}

/// Columns of a variant. @param posed null when no pose passed; the columns then only say why
Json variant_columns(const Json& source, const Asset* posed, const Provenance& provenance) {
  if (posed == nullptr) return {{"rejected_pose", true}, {"pose", to_json(provenance)}};
  AssetRecord record = record_from_columns(source);
  // Posing keeps mesh and tree; only lengths change, by the new normalisation, and directions.
  record.closest_bones = closest_bones_of(posed->skeleton);
  const Similarity again = provenance.renormalization;
  record.scale *= again.scale;
  for (std::size_t i = 0; i < 3; ++i)
    record.offset[i] = again.scale * record.offset[i] + again.offset[static_cast<Eigen::Index>(i)];
  Json columns = import_columns(record);
  columns["pose"] = to_json(provenance);
  return columns;
}

/// x → scale · x + offset, from the source to the dataset.
Similarity normalisation_of(const Json& columns) {
  const AssetRecord record = record_from_columns(columns);
  return {record.scale, Eigen::Vector3d(record.offset[0], record.offset[1], record.offset[2])};
}

/// True when this version of the program understands them.
bool readable(const Json& columns) {
  if (is_rejected_pose(columns)) return true;
  try {
    record_from_columns(columns);
    return true;
  } catch (const InputError&) {
    return false;
  }
}

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

/// The numbers that notes of one of these codes start with, added up.
std::size_t told_count(const std::vector<io::ImportNote>& notes, const std::vector<std::string>& codes) {
  std::size_t count = 0;
  for (const io::ImportNote& note : notes) {
    if (std::find(codes.begin(), codes.end(), note.code) != codes.end())
      count += std::strtoull(note.message.c_str(), nullptr, 10);
  }
  return count;
}

void measure(const Asset& asset, AssetRecord& record) {
  record.num_joints = asset.skeleton.size();
  record.num_vertices = asset.mesh.vertices.size();
  record.num_faces = asset.mesh.faces.size();
  record.animations = asset.animations.size();
  record.max_influences = asset.skin.largest_row();
  record.closest_bones = closest_bones_of(asset.skeleton);
  record.outside_share = outside_share(asset.skeleton.positions(), asset.mesh);
  record.skeleton = describe(asset.skeleton);
}

/// Brings an asset that was read into the frame and the form of the dataset.
void finish_import(PreparedAsset& prepared, const CleaningOptions& cleaning, bool creature, const std::string& name) {
  AssetRecord& record = prepared.record;
  const Similarity similarity = normalize(prepared.asset);
  record.scale = similarity.scale;
  record.offset = {similarity.offset.x(), similarity.offset.y(), similarity.offset.z()};
  if (!creature)
    record.findings = clean(prepared.asset, {record.lowest_weight_sum, record.repeated_names}, cleaning, name);
  if (auto finding = coarsen_skeleton(prepared.asset, cleaning.kept_joints, name))
    record.findings.push_back(std::move(*finding));
  measure(prepared.asset, record);
}

}  // namespace

Json import_columns(const AssetRecord& record) {
  Json columns = {{"version", kRecordVersion}};
  columns.update(Json(record));
  return columns;
}

bool is_rejected_pose(const Json& columns) { return columns.contains("rejected_pose"); }

AssetRecord record_from_columns(const Json& columns) {
  try {
    if (columns.at("version").get<int>() != kRecordVersion)
      throw InputError("", "/version", "is that of another program version");
    auto record = columns.get<AssetRecord>();
    if (record.offset.size() != 3) throw InputError("", "", "the record of an asset is damaged: offset");
    return record;
  } catch (const Json::exception& error) {
    throw InputError("", "", std::string("the record of an asset is damaged: ") + error.what());
  }
}

/// The first step of an asset, which everything else depends on.
struct SourcePreparer::Root {
  std::size_t variant = 0;
  Json options;
  std::function<Json()> columns;    ///< makes the asset available to the job and returns what was measured
  std::function<bool()> unchanged;  ///< the source still has the content of its id
};

SourcePreparer::SourcePreparer(std::filesystem::path out, StepPlan plan,
                               const std::shared_ptr<const FeatureExtractor>& extractor)
    : out_(std::move(out)), plan_(std::move(plan)), steps_(planned_steps(plan_, extractor)) {}

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
    if (done) return true;
    // A file that went away or changed meanwhile says nothing about what was to be prepared.
    if (!root.unchanged()) failure.fingerprint.clear();
    outcome.failures.push_back(std::move(failure));
    return false;
  };

  const std::string root_fingerprint = records.fingerprint(kImport, kImportVersion, root.options, {});
  if (!records.has(kImport) || records.steps.at(kImport).fingerprint != root_fingerprint ||
      !readable(records.columns(kImport))) {
    StepResult result{root_fingerprint, kImportVersion, root.options, {}, 0, 0, Json::object(), commit()};
    const std::string name = root.variant == 0 ? kImport : "augment";
    if (!attempt(name, root_fingerprint, [&] { result.columns = root.columns(); })) return outcome;
    // A record that names files of before goes from the disk before these change. A first one is saved with the first
    // step that follows: alone it saves nothing worth an fsync.
    const bool is_on_disk = !records.steps.empty();
    records.steps[kImport] = std::move(result);
    records.drop_stale();
    unsaved = true;
    if (is_on_disk) save();
  }
  outcome.imported = true;
  outcome.rejected_pose = is_rejected_pose(records.columns(kImport));
  if (!outcome.rejected_pose) job.set_normalisation(normalisation_of(records.columns(kImport)));
  for (const Step& step : steps_) {
    if (outcome.rejected_pose) break;
    if (!records.has_all(step.inputs) || up_to_date(step, job.places(), records)) continue;
    const std::string fingerprint = records.fingerprint(step.name, step.version, step.options, step.inputs);
    StepResult result{fingerprint, step.version, step.options, step.inputs, 0, 0, Json::object(), commit()};
    if (records.steps.erase(step.name) > 0) {
      // Whatever is half-replaced after a kill must not pass for done.
      records.drop_stale();
      save();
    }
    const bool done = attempt(step.name, fingerprint, [&] {
      step.clear(job.places());
      result.columns = step.run(job);
      if (!measure_files(step.outputs(job.places(), result.options), result))
        throw Error(step.name + " left out a file");
    });
    if (!done) continue;
    records.steps[step.name] = std::move(result);
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
  StepFailure unreadable{"", 0, kImport, "", task.source.file_identifier + ": its id cannot name a file", ""};
  const bool known =
      !id.empty() || try_work(
                         task.source.file_identifier, [&] { id = asset_id(task.source, reader_); }, unreadable);
  if (!known || !is_safe_id(id)) {
    outcome.assets.emplace_back().failures.push_back(std::move(unreadable));
    return outcome;
  }
  if (task.only_identify) {
    outcome.assets.emplace_back().id = id;
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
  root.options = {{"source", id}, {"cleaning", plan_.cleaning.to_json()}};
  if (!task.source.procedural() && task.source.format == io::RigFormat::kDataset) {
    // Assets of a dataset keep their ids, which say nothing about the content.
    try_work(
        task.source.file_identifier, [&] { root.options["content"] = reader_.content_id(task.source.rig()); },
        unreadable);
  }
  // Files whose materials say what alpha means: pictures of them changed when this was heeded.
  if (!task.source.procedural() && task.source.format == io::RigFormat::kGltf)
    root.options["alpha"] = "of the material";
  std::string pictures;
  if (!task.source.procedural()) pictures = io::pictures_id(task.source.rig());
  if (!pictures.empty()) root.options["pictures"] = pictures;
  root.columns = [&] { return import_columns(import().record); };
  root.unchanged = [&task, content = root.options.value("content", id), pictures, this] {
    if (task.source.procedural()) return true;
    try {
      return reader_.content_id(task.source.rig()) == content && io::pictures_id(task.source.rig()) == pictures;
    } catch (const Error&) {
      return false;
    }
  };
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
        {"source", root.options}, {"seed", plan_.seed}, {"variant", k}, {"poses", settings_of(plan_.poses)}};
    variant_root.unchanged = root.unchanged;
    variant_root.columns = [&] {
      pose();
      return columns;
    };
    outcome.assets.push_back(prepare_asset(variant_root, variant, task, observe));
  }
  return outcome;
}

std::size_t invented_rows(const std::vector<io::ImportNote>& notes) {
  return told_count(notes, {"nan_weights", "zero_weights"});
}

PreparedAsset import_asset(const AssetSource& source, const CleaningOptions& cleaning, const io::RigReader& reader) {
  PreparedAsset prepared;
  AssetRecord& record = prepared.record;
  if (source.procedural()) {
    prepared.asset = creatures::make_creature(source.seed, source.index);
    record.source = "procedural:" + creatures::creature_family(source.seed, source.index);
  } else {
    io::ImportedAsset imported = reader.read(source.rig());
    prepared.asset = std::move(imported.asset);
    record.source = "real";
    record.invented_rows = invented_rows(imported.notes);
    record.lowest_weight_sum = imported.lowest_weight_sum;
    record.repeated_names = told_count(imported.notes, {"duplicate_joint_names"});
    for (const io::ImportNote& note : imported.notes) {
      if (std::find(record.repairs.begin(), record.repairs.end(), note.code) == record.repairs.end())
        record.repairs.push_back(note.code);
    }
  }
  finish_import(prepared, cleaning, source.procedural(), source.file_identifier);
  return prepared;
}

PreparedAsset import_asset(Asset asset, const CleaningOptions& cleaning, const std::string& name) {
  const std::vector<std::string> unsound = anigen::validate(asset, 1);
  if (!unsound.empty()) throw InputError(name, "", unsound.front());
  PreparedAsset prepared;
  prepared.asset = std::move(asset);
  prepared.record.source = "real";
  finish_import(prepared, cleaning, false, name);
  return prepared;
}

}  // namespace anigen::prepare
