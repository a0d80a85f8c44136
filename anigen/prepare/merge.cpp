#include "anigen/prepare/merge.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <set>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/core/text.h"
#include "anigen/core/version.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/prepare/pose_augmentation.h"
#include "anigen/prepare/run.h"

namespace anigen::prepare {

namespace {

namespace fs = std::filesystem;

constexpr char kId[] = "sha256";

bool written_at_times(const std::string& column) {
  return column == "aesthetic_score" || column == "near_skeleton_of" || column.rfind("feature_", 0) == 0;
}

bool holds_flags(const CsvTable& table, std::size_t column) {
  bool any = false;
  for (const auto& row : table.rows) {
    if (row[column].empty()) continue;
    if (row[column] != csv_flag(true) && row[column] != csv_flag(false)) return false;
    any = true;
  }
  return any;
}

constexpr char kFeatureSteps[] = "features/";

/// Of all manifests, in order of the sources.
std::vector<const ManifestEntry*> entries_of(const std::vector<Manifest>& manifests) {
  std::vector<const ManifestEntry*> entries;
  for (const Manifest& manifest : manifests) {
    for (const ManifestEntry& entry : manifest.entries) entries.push_back(&entry);
  }
  std::sort(entries.begin(), entries.end(),
            [](const ManifestEntry* a, const ManifestEntry* b) { return a->number < b->number; });
  return entries;
}

/// The failure that keeps an asset out of the dataset: without these steps it has nothing that could be trained on.
const StepFailure* fatal_failure(const ManifestEntry& entry, std::size_t variant) {
  for (const StepFailure& failure : entry.failures) {
    if (failure.variant != variant) continue;
    if (failure.step == kImport || failure.step == "augment" || failure.step == "skeleton") return &failure;
  }
  return nullptr;
}

std::string variant_name(const AssetSource& source, std::size_t variant) {
  return source.file_identifier + (variant == 0 ? "" : "#pose" + std::to_string(variant - 1));
}

/// A posed variant, made here or in the dataset that was given.
bool is_pose(const DatasetRow& row) { return row.variant > 0 || !row.entry.source.variant_of.empty(); }

/// Id of the asset, or of that of which a dataset that was given has it as a pose.
const std::string& original_of(const DatasetEntry& entry) {
  return entry.source.variant_of.empty() ? entry.id : entry.source.variant_of;
}

/// Adds the asset, or says why not. @return whether it is in
bool add_row(const fs::path& out, const ManifestEntry& entry, std::size_t variant, const std::string& id,
             DatasetRows& found) {
  if (const StepFailure* failure = fatal_failure(entry, variant)) {
    found.rejected.push_back({variant_name(entry.source, variant), failure->reason, failure->step, failure->rule});
    return false;
  }
  const fs::path file = AssetPlaces{out, id}.record();
  DatasetRow row;
  row.records = read_step_records(file);
  if (!row.records.has(kImport))
    throw InputError(file.string(), "", "missing or damaged: run " + entry.source.file_identifier + " again");
  if (is_rejected_pose(row.columns(kImport))) {
    ++found.rejected_poses;
    return false;
  }
  row.entry = {id, entry.source, record_from_columns(row.columns(kImport)), false};
  row.variant = variant;
  if (variant > 0) row.variant_of = entry.id;
  row.aesthetic_score = entry.aesthetic_score;
  found.rows.push_back(std::move(row));
  return true;
}

/// Marks or takes out sources whose skeleton is nearly that of an earlier one; variants share the fate of theirs.
void apply_near(NearSkeletons near, DatasetRows& found) {
  if (near == NearSkeletons::kIgnore) return;
  std::vector<std::size_t> sources;
  std::vector<SkeletonDescriptor> descriptors;
  for (std::size_t i = 0; i < found.rows.size(); ++i) {
    if (found.rows[i].variant > 0) continue;
    sources.push_back(i);
    descriptors.push_back(found.rows[i].entry.record.skeleton);
  }
  std::map<std::string, std::string> original;
  const auto duplicates = near_duplicates(descriptors);
  for (std::size_t k = 0; k < duplicates.size(); ++k) {
    if (duplicates[k]) original[found.rows[sources[k]].entry.id] = found.rows[sources[*duplicates[k]]].entry.id;
  }
  std::vector<DatasetRow> kept;
  for (DatasetRow& row : found.rows) {
    const auto twin = original.find(row.variant > 0 ? row.variant_of : row.entry.id);
    if (twin != original.end()) row.near_skeleton_of = twin->second;
    if (near == NearSkeletons::kDrop && twin != original.end()) {
      if (row.variant == 0) {
        found.rejected.push_back({row.entry.source.file_identifier, "skeleton nearly that of " + twin->second, kImport,
                                  "near_duplicate_skeleton"});
      }
      continue;
    }
    kept.push_back(std::move(row));
  }
  found.rows = std::move(kept);
}

constexpr double kDefaultTestFraction = 0.333;

void mark(std::vector<DatasetRow>& rows, const SplitOptions& options, const QualityLimits& limits, bool procedural) {
  // Units of the draw, by what a test asset must not share with one for training: the asset itself, or its skeleton.
  std::map<std::string, std::vector<std::size_t>> units;
  std::vector<std::size_t> candidates;
  std::vector<std::string> ids;
  std::size_t flagged = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const DatasetEntry& entry = rows[i].entry;
    if (rows[i].variant > 0 || entry.source.procedural() != procedural || !usable(entry.record, limits)) continue;
    candidates.push_back(i);
    const std::string& name = options.by_skeleton && !procedural ? entry.record.skeleton.topology : original_of(entry);
    std::vector<std::size_t>& unit = units[name];
    if (unit.empty()) ids.push_back(name);
    unit.push_back(i);
    flagged += entry.source.is_test;
  }
  const bool own_split =
      !procedural && !options.by_skeleton && !options.test_count && !options.test_fraction && flagged > 0;
  if (own_split) {
    for (const std::size_t i : candidates) rows[i].entry.is_test = rows[i].entry.source.is_test;
    return;
  }
  const std::size_t count = procedural ? options.procedural_test
                                       : options.test_count.value_or(prepare::test_count(
                                             ids.size(), options.test_fraction.value_or(kDefaultTestFraction)));
  if (count > ids.size()) {
    throw InputError("", procedural ? "--procedural-test" : "--test-count",
                     std::to_string(count) + (options.by_skeleton && !procedural ? " test skeletons" : " test assets") +
                         " wanted, but only " + std::to_string(ids.size()) + " are usable");
  }
  const std::vector<bool> chosen = choose_test(ids, count, options.seed);
  for (std::size_t k = 0; k < ids.size(); ++k) {
    for (const std::size_t i : units.at(ids[k])) rows[i].entry.is_test = chosen[k];
  }
}

/// The usable assets that split.test_names names.
void mark_named(std::vector<DatasetRow>& rows, const std::vector<std::string>& names, const QualityLimits& limits) {
  constexpr const char* kOption = "--test-split";
  io::NameIndex index;
  for (const DatasetRow& row : rows) {
    if (row.variant > 0) continue;
    const AssetSource& source = row.entry.source;
    index.add(row.entry.id, {source.uuid, source.local_path, source.file_identifier});
  }
  std::set<std::string> test, unknown;
  for (const std::string& name : names) {
    const std::string id = index.find_one(name, "", kOption);
    (id.empty() ? unknown : test).insert(id.empty() ? name : id);
  }
  if (test.empty())
    throw InputError("", kOption,
                     "no asset of the dataset is called like one of its " + std::to_string(names.size()) +
                         " names: " + listed(unknown));
  if (!unknown.empty())
    log::warn("{}: {} of {} names are those of no asset of the dataset ({}); rejected.csv tells what was left out",
              kOption, unknown.size(), names.size(), listed(unknown));
  std::set<std::string> unusable;
  for (DatasetRow& row : rows) {
    if (row.variant > 0 || test.count(row.entry.id) == 0) continue;
    row.entry.is_test = usable(row.entry.record, limits);
    if (!row.entry.is_test) unusable.insert(row.entry.id);
  }
  if (!unusable.empty())
    log::warn("{}: {} of the assets that it names are not usable ({}); they stand in splits/unusable.txt", kOption,
              unusable.size(), listed(unusable));
}

/// Columns of what is known of the assets themselves.
CsvTable metadata_table(const std::vector<DatasetRow>& rows, const QualityLimits& limits) {
  CsvTable table;
  table.columns = {"sha256",      "file_identifier", "local_path",   "uuid",           "source_path",
                   "source",      "num_joints",      "num_vertices", "num_faces",      "max_influences",
                   "is_bad_skin", "is_bad_skeleton", "is_test",      "distinct_bones", "repairs"};
  for (const DatasetRow& row : rows) {
    const DatasetEntry& entry = row.entry;
    const AssetRecord& record = entry.record;
    table.rows.push_back({entry.id, entry.source.file_identifier, entry.source.local_path, entry.source.uuid,
                          entry.source.source_path(), record.source, std::to_string(record.num_joints),
                          std::to_string(record.num_vertices), std::to_string(record.num_faces),
                          std::to_string(record.max_influences), csv_flag(bad_skin(record, limits)),
                          csv_flag(!usable(record, limits)), csv_flag(entry.is_test),
                          csv_flag(distinct_bones(record, limits)), joined(record.repairs, " ")});
  }
  return table;
}

bool failed(const ManifestEntry& entry, std::size_t variant) {
  return std::any_of(entry.failures.begin(), entry.failures.end(),
                     [&](const StepFailure& failure) { return failure.variant == variant; });
}

/// The planned steps that a record lacks, by the words of the plan.
std::string missing_steps(const StepRecords& records, const StepPlan& plan) {
  std::string missing;
  for (const std::string& word : step_words()) {
    if (word == "augment" || !plan.wants(word)) continue;
    const std::string name = word == "features" ? "features/" : word;
    const auto found = records.steps.lower_bound(name);
    const bool there =
        found != records.steps.end() && (word == "features" ? found->first.rfind(name, 0) == 0 : found->first == name);
    if (!there) missing += (missing.empty() ? "" : ", ") + word;
  }
  return missing;
}

/// The plan makes this step. What earlier plans made may have been removed since: pictures, once features are there.
bool planned(const std::string& step, const StepPlan& plan) {
  if (step.rfind("features/", 0) == 0) return plan.wants("features") && step == "features/" + plan.features.model;
  return plan.wants(step);
}

/// @return what is wrong with one asset; empty: nothing
std::string gap_of(const AssetPlaces& places, const ManifestEntry& entry, std::size_t variant, const StepPlan& plan) {
  const StepRecords records = read_step_records(places.record());
  if (!records.has(kImport)) return failed(entry, variant) ? "" : "has neither a record nor a failure";
  if (is_rejected_pose(records.columns(kImport))) return "";
  for (const auto& [name, step] : records.steps) {
    if (!planned(name, plan)) continue;
    StepResult now;
    const bool complete = measure_files(recorded_files(name, step.options, places), now);
    if (!complete) return "lacks a file of " + name;
    if (now.files != step.files || now.bytes != step.bytes) return "has files of " + name + " of another size";
  }
  const std::string missing = missing_steps(records, plan);
  return missing.empty() || failed(entry, variant) ? "" : "was not taken through " + missing;
}

/// Of a source and its variants.
std::string gaps_of(const std::filesystem::path& out, const ManifestEntry& entry, const StepPlan& plan) {
  if (entry.id.empty()) return failed(entry, 0) ? "" : "was not identified, and nothing says why";
  std::string gap = gap_of({out, entry.id}, entry, 0, plan);
  if (!gap.empty() || !read_step_records(AssetPlaces{out, entry.id}.record()).has(kImport)) return gap;
  for (std::size_t k = 0; k < plan.variants && gap.empty(); ++k) {
    gap = gap_of({out, variant_id(entry.id, plan.seed, k, plan.poses)}, entry, variant_number(k), plan);
    if (!gap.empty()) gap = "pose " + std::to_string(k) + " " + gap;
  }
  return gap;
}

// Results of another build are kept where the version of their step is the same, but not without saying so.
void report_other_programs(const std::vector<DatasetRow>& rows) {
  std::size_t kept = 0;
  std::string of;
  for (const DatasetRow& row : rows) {
    for (const auto& [step, result] : row.records.steps) {
      if (result.commit == commit()) continue;
      ++kept;
      of = result.commit;
    }
  }
  if (kept == 0) return;
  log::warn("{} results of steps that {} made are kept by {}: the versions of the steps are the same", kept,
            named_commit(of), named_commit(commit()));
}

}  // namespace

void carry_over_columns(CsvTable& table, const CsvTable& earlier) {
  const std::size_t id = table.column(kId), earlier_id = earlier.column(kId);
  if (id == CsvTable::kMissing || earlier_id == CsvTable::kMissing) return;
  std::map<std::string, const std::vector<std::string>*> known;
  for (const auto& row : earlier.rows) known.emplace(row[earlier_id], &row);
  for (std::size_t column = 0; column < earlier.columns.size(); ++column) {
    const std::string& name = earlier.columns[column];
    if (table.column(name) != CsvTable::kMissing || written_at_times(name)) continue;
    const std::string unknown = holds_flags(earlier, column) ? csv_flag(false) : std::string();
    table.columns.push_back(name);
    for (auto& row : table.rows) {
      const auto found = known.find(row[id]);
      row.push_back(found == known.end() ? unknown : (*found->second)[column]);
    }
  }
}

NearSkeletons near_skeletons_of_preset(const std::string& preset) {
  return preset == "anymate" ? NearSkeletons::kDrop : NearSkeletons::kFlag;
}

NearSkeletons parse_near_skeletons(const std::string& word) {
  for (const NearSkeletons choice : {NearSkeletons::kIgnore, NearSkeletons::kFlag, NearSkeletons::kDrop}) {
    if (word == name_of(choice)) return choice;
  }
  throw InputError("", "--near-skeletons", "must be ignore, flag or drop, got \"" + word + "\"");
}

const char* name_of(NearSkeletons choice) {
  return choice == NearSkeletons::kIgnore ? "ignore" : choice == NearSkeletons::kFlag ? "flag" : "drop";
}

DatasetRows collect_rows(const fs::path& out, const std::vector<Manifest>& manifests, const StepPlan& plan,
                         NearSkeletons near) {
  DatasetRows found;
  std::map<std::string, const ManifestEntry*> first;
  for (const ManifestEntry* entry : entries_of(manifests)) {
    if (!entry->id.empty()) {
      const auto [earlier, added] = first.emplace(entry->id, entry);
      if (!added) {
        found.rejected.push_back({entry->source.file_identifier,
                                  "same content as " + earlier->second->source.file_identifier, "identify", ""});
        continue;
      }
    }
    for (const StepFailure& failure : entry->failures) found.failures.emplace_back(entry->source, failure);
    if (!add_row(out, *entry, 0, entry->id, found)) continue;
    for (std::size_t k = 0; k < plan.variants; ++k)
      add_row(out, *entry, variant_number(k), variant_id(entry->id, plan.seed, k, plan.poses), found);
  }
  apply_near(near, found);
  return found;
}

CsvTable dataset_table(const std::vector<DatasetRow>& rows, const QualityLimits& limits) {
  report_other_programs(rows);
  std::set<std::string> models;
  bool scored = !rows.empty(), near = false;
  for (const DatasetRow& row : rows) {
    scored = scored && !row.aesthetic_score.empty();
    near = near || !row.near_skeleton_of.empty();
    for (const auto& [step, result] : row.records.steps) {
      if (step.rfind(kFeatureSteps, 0) == 0) models.insert(step.substr(sizeof kFeatureSteps - 1));
    }
  }
  CsvTable table = metadata_table(rows, limits);
  const auto column = [&](const std::string& name, const auto& cell) {
    table.columns.push_back(name);
    for (std::size_t i = 0; i < rows.size(); ++i) table.rows[i].push_back(cell(rows[i]));
  };
  const auto flag = [&](const std::string& name, const std::string& step) {
    column(name, [&](const DatasetRow& row) { return csv_flag(row.records.has(step)); });
  };
  const auto count = [&](const std::string& name, const std::string& step) {
    column(name, [&](const DatasetRow& row) { return std::to_string(row.columns(step).value(name, std::size_t{0})); });
  };
  if (scored) column("aesthetic_score", [](const DatasetRow& row) { return row.aesthetic_score; });
  flag("voxelized", "voxels");
  count("num_voxels", "voxels");
  count("num_skeleton_voxels", "voxels");
  flag("rendered", "views");
  count("views", "views");
  flag("cond_rendered", "cond_views");
  count("cond_views", "cond_views");
  for (const std::string& model : models) flag("feature_" + model, kFeatureSteps + model);
  column("variant_of", [](const DatasetRow& row) {
    const std::string& of_dataset = row.entry.source.variant_of;  // of which its own variants are poses, too
    return of_dataset.empty() ? row.variant_of : of_dataset;
  });
  column("pose", [](const DatasetRow& row) {
    const Json& columns = row.columns(kImport);
    return columns.contains("pose") ? columns.at("pose").value("kind", std::string()) : std::string();
  });
  if (near) column("near_skeleton_of", [](const DatasetRow& row) { return row.near_skeleton_of; });
  return table;
}

void SplitOptions::validate() const {
  if (test_fraction) prepare::test_count(0, *test_fraction);
}

void SplitOptions::fields(ConfigFields& f) {
  f.custom(
      "seed", {{"type", "integer"}}, [&](const Json& json) { json.get_to(seed); }, [&] { return Json(seed); });
  f("procedural_test", procedural_test, {0});
  if (!f.writes() || by_skeleton) f("by_skeleton", by_skeleton);
  if (!f.writes() || test_fraction) f("test_fraction", test_fraction);
  if (!f.writes() || test_count) f("test_count", test_count, FieldRange<std::int64_t>{0});
  if (!f.writes() || !test_names.empty()) f("test_names", test_names);
}

void mark_test(std::vector<DatasetRow>& rows, const SplitOptions& options, const QualityLimits& limits) {
  for (DatasetRow& row : rows) row.entry.is_test = false;
  if (options.test_names.empty()) {
    mark(rows, options, limits, false);
    mark(rows, options, limits, true);
  } else {
    mark_named(rows, options.test_names, limits);
  }
  std::set<std::string> test;
  for (DatasetRow& row : rows) {
    const AssetSource& source = row.entry.source;
    // Whatever was asked for: no training takes these creatures.
    if (row.variant == 0 && source.procedural() && creature_seeds::is_test(source.seed))
      row.entry.is_test = usable(row.entry.record, limits);
    if (row.entry.is_test) test.insert(row.entry.id);
    if (row.entry.is_test && source.procedural() && source.seed >= creature_seeds::kFirstOfStreams) {
      throw InputError(source.file_identifier, "--procedural-test",
                       "is a creature of a seed for streams, which trainings draw from; it cannot be a test asset");
    }
  }
  // Poses of a dataset that was given stay with their source: where one is for testing, all are.
  std::set<std::string> tested;
  for (const DatasetRow& row : rows) {
    if (row.variant == 0 && row.entry.is_test) tested.insert(original_of(row.entry));
  }
  for (DatasetRow& row : rows) {
    if (row.variant > 0 || tested.count(original_of(row.entry)) == 0) continue;
    row.entry.is_test = usable(row.entry.record, limits);
    if (row.entry.is_test) test.insert(row.entry.id);
  }
  for (DatasetRow& row : rows) {
    if (row.variant > 0) row.entry.is_test = test.count(row.variant_of) > 0;
  }
}

SplitCounts write_splits(const std::filesystem::path& out, const std::vector<DatasetRow>& rows,
                         const QualityLimits& limits) {
  std::map<std::string, std::string> lists{{"train", ""}, {"test", ""}, {"test_variants", ""}, {"unusable", ""}};
  std::map<std::string, std::size_t> counts;
  for (const DatasetRow& row : rows) {
    const char* list = !usable(row.entry.record, limits) ? "unusable"
                       : !row.entry.is_test              ? "train"
                       : is_pose(row)                    ? "test_variants"
                                                         : "test";
    lists[list] += row.entry.id + "\n";
    ++counts[list];
  }
  for (const auto& [list, ids] : lists) write_file_atomically(out / "splits" / (list + ".txt"), ids);
  return {counts["train"], counts["test"], counts["unusable"]};
}

std::vector<std::string> find_gaps(const std::filesystem::path& out, const std::vector<Manifest>& manifests,
                                   const StepPlan& plan) {
  std::vector<const ManifestEntry*> entries = entries_of(manifests);
  // A repeated content has the files of the first source that has it.
  std::set<std::string> seen;
  entries.erase(
      std::remove_if(entries.begin(), entries.end(),
                     [&](const ManifestEntry* entry) { return !entry->id.empty() && !seen.insert(entry->id).second; }),
      entries.end());
  std::vector<std::string> found(entries.size()), gaps;
  parallel_for(entries.size(), [&](std::size_t i) { found[i] = gaps_of(out, *entries[i], plan); });
  for (std::size_t i = 0; i < entries.size(); ++i) {
    if (!found[i].empty()) gaps.push_back(entries[i]->source.file_identifier + " " + found[i]);
  }
  return gaps;
}

fs::path pieces_folder(const fs::path& out) { return run_folder(out) / "pieces"; }

Pieces::Pieces(const fs::path& out, const std::string& phase, const Shard& shard, std::size_t tasks,
               std::size_t per_piece)
    : folder_(pieces_folder(out)),
      prefix_(phase + "-" + shard.name() + "-"),
      tasks_(tasks),
      per_piece_(std::max<std::size_t>(1, per_piece)) {}

std::pair<std::size_t, std::size_t> Pieces::range(std::size_t piece) const {
  return {piece * per_piece_, std::min(tasks_, (piece + 1) * per_piece_)};
}

std::string Pieces::name(std::size_t piece) const {
  char number[24];
  std::snprintf(number, sizeof number, "%06zu", piece);
  return prefix_ + number;
}

fs::path Pieces::file(std::size_t piece) const { return folder_ / (name(piece) + ".json"); }

std::optional<std::vector<SourceOutcome>> Pieces::read(std::size_t piece) const {
  try {
    auto outcomes = read_json(file(piece)).get<std::vector<SourceOutcome>>();
    const auto [begin, end] = range(piece);
    if (outcomes.size() == end - begin) return outcomes;
  } catch (const std::exception&) {  // missing, or damaged: the piece is done again
  }
  return std::nullopt;
}

void Pieces::write(std::size_t piece, const std::vector<SourceOutcome>& outcomes) const {
  write_file_atomically(file(piece), Json(outcomes).dump(-1, ' ', false, Json::error_handler_t::replace) + "\n");
}

}  // namespace anigen::prepare
