#include "anigen/prepare/dataset.h"

#include <algorithm>
#include <map>
#include <new>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/progress.h"
#include "anigen/io/gltf.h"
#include "anigen/prepare/import_asset.h"
#include "anigen/prepare/metadata.h"
#include "anigen/prepare/skeleton_archive.h"
#include "anigen/prepare/split.h"

namespace anigen::prepare {
namespace {

namespace fs = std::filesystem;

/// What became of one source.
struct Outcome {
  std::string id;
  AssetRecord record;
  std::string rejection;  ///< empty: it was prepared
  bool reused = false;
};

struct Places {
  fs::path record, skeleton, asset;
  Places(const fs::path& out, const std::string& id)
      : record(out / "records" / (id + ".json")),
        skeleton(out / "skeleton" / id / "skeleton_voxelized.npz"),
        asset(out / "assets" / (id + ".glb")) {}
};

std::string compute_id(const AssetSource& source, std::string& rejection) {
  try {
    return asset_id(source);
  } catch (const InputError& error) {
    rejection = error.what();
    return "";
  }
}

void write_outputs(const Places& places, const PreparedAsset& prepared, bool keep_asset) {
  write_skeleton_archive(places.skeleton, prepared.asset);
  if (keep_asset) {
    io::ExportOptions exported;
    exported.influences = std::max<std::size_t>(1, prepared.record.max_influences);
    io::write_gltf(places.asset, prepared.asset, exported);
  }
  // Last, because its presence says that the others are complete.
  write_record(places.record, prepared.record);
}

void prepare_one(const PrepareOptions& options, const AssetSource& source, Outcome& outcome) {
  const Places places(options.out, outcome.id);
  std::error_code ignored;
  if (fs::exists(places.skeleton, ignored) && (!options.keep_assets || fs::exists(places.asset, ignored))) {
    if (const auto record = read_record(places.record)) {
      outcome.record = *record;
      outcome.reused = true;
      return;
    }
  }
  try {
    const PreparedAsset prepared = import_asset(source);
    outcome.record = prepared.record;
    write_outputs(places, prepared, options.keep_assets);
  } catch (const InputError& error) {
    outcome.rejection = error.what();
  } catch (const std::bad_alloc&) {
    outcome.rejection = source.file_identifier + ": needs more memory than there is";
  }
}

/// Sources with the content of an earlier one are rejected before anything is written twice.
void reject_repeats(const std::vector<AssetSource>& sources, std::vector<Outcome>& outcomes) {
  std::map<std::string, std::size_t> first;
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    if (!outcomes[i].rejection.empty()) continue;
    const auto [found, added] = first.emplace(outcomes[i].id, i);
    if (!added) outcomes[i].rejection = "same content as " + sources[found->second].file_identifier;
  }
}

void mark_test(std::vector<DatasetEntry>& entries, const PrepareOptions& options, bool procedural) {
  std::vector<std::size_t> candidates;
  std::vector<std::string> ids;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    if (entries[i].source.procedural() != procedural || !usable(entries[i].record, options.limits)) continue;
    candidates.push_back(i);
    ids.push_back(entries[i].id);
  }
  const std::size_t count =
      procedural ? options.procedural_test : options.test_count.value_or(test_count(ids.size(), options.test_fraction));
  if (count > ids.size()) {
    throw InputError(
        "", procedural ? "--procedural-test" : "--test-count",
        std::to_string(count) + " test assets wanted, but only " + std::to_string(ids.size()) + " are usable");
  }
  const std::vector<bool> chosen = choose_test(ids, count, options.seed);
  for (std::size_t k = 0; k < candidates.size(); ++k) entries[candidates[k]].is_test = chosen[k];
}

void write_tables(const PrepareOptions& options, const std::vector<DatasetEntry>& entries,
                  const std::vector<Rejected>& rejected, PrepareSummary& summary) {
  std::string train, test, unusable;
  for (const DatasetEntry& entry : entries) {
    const bool good = usable(entry.record, options.limits);
    ++(entry.source.procedural() ? summary.procedural : summary.real);
    summary.bad_skeleton += !good;
    summary.bad_skin += bad_skin(entry.record, options.limits);
    summary.train += good && !entry.is_test;
    summary.test += entry.is_test;
    (!good ? unusable : entry.is_test ? test : train) += entry.id + "\n";
  }
  CsvTable table;
  table.columns = {"file_identifier", "reason"};
  for (const Rejected& one : rejected) table.rows.push_back({one.file_identifier, one.reason});
  write_file_atomically(options.out / "rejected.csv", to_csv(table));
  write_file_atomically(options.out / "splits" / "train.txt", train);
  write_file_atomically(options.out / "splits" / "test.txt", test);
  write_file_atomically(options.out / "splits" / "unusable.txt", unusable);
  write_file_atomically(options.out / "metadata.csv", to_csv(metadata_table(entries, options.limits)));
}

}  // namespace

PrepareSummary prepare_dataset(const PrepareOptions& options) {
  const std::vector<AssetSource>& sources = options.sources;
  if (sources.empty())
    throw InputError("", "", "nothing to prepare: name input folders or a number of procedural assets");
  test_count(0, options.test_fraction);  // refuses a bad fraction before hours of work

  std::vector<Outcome> outcomes(sources.size());
  parallel_for(sources.size(), [&](std::size_t i) { outcomes[i].id = compute_id(sources[i], outcomes[i].rejection); });
  reject_repeats(sources, outcomes);
  {
    Progress progress("prepare", sources.size(), "assets");
    parallel_for(sources.size(), [&](std::size_t i) {
      if (interrupt_requested()) return;
      if (outcomes[i].rejection.empty()) prepare_one(options, sources[i], outcomes[i]);
      progress.advance();
    });
  }
  if (interrupt_requested())
    throw Interrupted("interrupted: what was finished is kept, the same command goes on from there");

  PrepareSummary summary;
  std::vector<DatasetEntry> entries;
  for (std::size_t i = 0; i < sources.size(); ++i) {
    if (!outcomes[i].rejection.empty()) {
      summary.rejected.push_back({sources[i].file_identifier, outcomes[i].rejection});
      log::warn("rejected {}: {}", sources[i].file_identifier, outcomes[i].rejection);
      continue;
    }
    summary.reused += outcomes[i].reused;
    entries.push_back({outcomes[i].id, sources[i], outcomes[i].record, false});
  }
  if (entries.empty()) {
    write_tables(options, entries, summary.rejected, summary);
    throw InputError((options.out / "rejected.csv").string(), "",
                     "none of the " + std::to_string(sources.size()) + " sources could be used; this file says why");
  }
  mark_test(entries, options, false);
  mark_test(entries, options, true);
  write_tables(options, entries, summary.rejected, summary);
  return summary;
}

Json to_json(const PrepareSummary& summary) {
  Json rejected = Json::array();
  for (const Rejected& one : summary.rejected) {
    rejected.push_back({{"file_identifier", one.file_identifier}, {"reason", one.reason}});
  }
  return {{"prepared", summary.prepared()},
          {"real", summary.real},
          {"procedural", summary.procedural},
          {"reused", summary.reused},
          {"bad_skeleton", summary.bad_skeleton},
          {"bad_skin", summary.bad_skin},
          {"train", summary.train},
          {"test", summary.test},
          {"rejected", rejected}};
}

std::string to_text(const PrepareSummary& summary) {
  const auto n = [](std::size_t count) { return std::to_string(count); };
  std::string text = "prepared " + n(summary.prepared()) + " assets (" + n(summary.real) + " real, " +
                     n(summary.procedural) + " procedural; " + n(summary.reused) + " were there already)\n" + "train " +
                     n(summary.train) + ", test " + n(summary.test) + ", not usable " + n(summary.bad_skeleton) +
                     ", bad skin " + n(summary.bad_skin) + "\n";
  if (!summary.rejected.empty()) text += "rejected " + n(summary.rejected.size()) + ", see rejected.csv:\n";
  for (const Rejected& one : summary.rejected) text += "  " + one.file_identifier + ": " + one.reason + "\n";
  return text;
}

}  // namespace anigen::prepare
