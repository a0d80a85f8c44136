#include "anigen/prepare/run/dataset_rows.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/prepare/augment/pose_augmentation.h"
#include "anigen/prepare/steps/asset_places.h"
#include "anigen/prepare/steps/import_columns.h"
#include "anigen/prepare/steps/prepare_source.h"

namespace anigen::prepare {
namespace {

namespace fs = std::filesystem;

constexpr char kFeatures[] = "features/";

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
  if (!row.records.has(kImport)) {
    throw InputError(file.string(), "", "missing or damaged: run " + entry.source.file_identifier + " again");
  }
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

}  // namespace

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
  std::vector<const ManifestEntry*> entries;
  for (const Manifest& manifest : manifests) {
    for (const ManifestEntry& entry : manifest.entries) entries.push_back(&entry);
  }
  std::sort(entries.begin(), entries.end(),
            [](const ManifestEntry* a, const ManifestEntry* b) { return a->number < b->number; });
  DatasetRows found;
  std::map<std::string, const ManifestEntry*> first;
  for (const ManifestEntry* entry : entries) {
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
    for (std::size_t k = 0; k < plan.variants; ++k) {
      add_row(out, *entry, variant_number(k), variant_id(entry->id, plan.seed, k, plan.poses), found);
    }
  }
  apply_near(near, found);
  return found;
}

CsvTable dataset_table(const std::vector<DatasetRow>& rows, const QualityLimits& limits) {
  std::vector<DatasetEntry> entries;
  std::set<std::string> models;
  bool scored = !rows.empty(), near = false;
  for (const DatasetRow& row : rows) {
    entries.push_back(row.entry);
    scored = scored && !row.aesthetic_score.empty();
    near = near || !row.near_skeleton_of.empty();
    for (const auto& [step, result] : row.records.steps) {
      if (step.rfind(kFeatures, 0) == 0) models.insert(step.substr(sizeof kFeatures - 1));
    }
  }
  CsvTable table = metadata_table(entries, limits);
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
  for (const std::string& model : models) flag("feature_" + model, kFeatures + model);
  column("variant_of", [](const DatasetRow& row) { return row.variant_of; });
  column("pose", [](const DatasetRow& row) {
    const Json& columns = row.columns(kImport);
    return columns.contains("pose") ? columns.at("pose").value("kind", std::string()) : std::string();
  });
  if (near) column("near_skeleton_of", [](const DatasetRow& row) { return row.near_skeleton_of; });
  return table;
}

}  // namespace anigen::prepare
