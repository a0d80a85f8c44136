#include "anigen/prepare/run/verify.h"

#include <algorithm>
#include <set>

#include "anigen/core/parallel.h"
#include "anigen/prepare/augment/pose_augmentation.h"
#include "anigen/prepare/steps/import_columns.h"
#include "anigen/prepare/steps/prepare_source.h"
#include "anigen/prepare/steps/recorded_files.h"

namespace anigen::prepare {
namespace {

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

}  // namespace

std::vector<std::string> find_gaps(const std::filesystem::path& out, const std::vector<Manifest>& manifests,
                                   const StepPlan& plan) {
  std::vector<const ManifestEntry*> entries;
  for (const Manifest& manifest : manifests) {
    for (const ManifestEntry& entry : manifest.entries) entries.push_back(&entry);
  }
  std::sort(entries.begin(), entries.end(),
            [](const ManifestEntry* a, const ManifestEntry* b) { return a->number < b->number; });
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

}  // namespace anigen::prepare
