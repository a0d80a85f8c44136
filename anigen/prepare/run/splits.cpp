#include "anigen/prepare/run/splits.h"

#include <algorithm>
#include <set>
#include <string>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/io/rigs/split.h"
#include "anigen/prepare/split.h"

namespace anigen::prepare {
namespace {

constexpr double kDefaultTestFraction = 0.333;

void mark(std::vector<DatasetRow>& rows, const SplitOptions& options, const QualityLimits& limits, bool procedural) {
  std::vector<std::size_t> candidates;
  std::vector<std::string> ids;
  std::size_t flagged = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const DatasetEntry& entry = rows[i].entry;
    if (rows[i].variant > 0 || entry.source.procedural() != procedural || !usable(entry.record, limits)) continue;
    candidates.push_back(i);
    ids.push_back(entry.id);
    flagged += entry.source.is_test;
  }
  const bool own_split = !procedural && !options.test_count && !options.test_fraction && flagged > 0;
  if (own_split) {
    for (const std::size_t i : candidates) rows[i].entry.is_test = rows[i].entry.source.is_test;
    return;
  }
  const std::size_t count =
      procedural
          ? options.procedural_test
          : options.test_count.value_or(test_count(ids.size(), options.test_fraction.value_or(kDefaultTestFraction)));
  if (count > ids.size()) {
    throw InputError(
        "", procedural ? "--procedural-test" : "--test-count",
        std::to_string(count) + " test assets wanted, but only " + std::to_string(ids.size()) + " are usable");
  }
  const std::vector<bool> chosen = choose_test(ids, count, options.seed);
  for (std::size_t k = 0; k < candidates.size(); ++k) rows[candidates[k]].entry.is_test = chosen[k];
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
                         " names: " + io::listed(unknown));
  if (!unknown.empty())
    log::warn("{}: {} of {} names are those of no asset of the dataset ({}); rejected.csv tells what was left out",
              kOption, unknown.size(), names.size(), io::listed(unknown));
  std::set<std::string> unusable;
  for (DatasetRow& row : rows) {
    if (row.variant > 0 || test.count(row.entry.id) == 0) continue;
    row.entry.is_test = usable(row.entry.record, limits);
    if (!row.entry.is_test) unusable.insert(row.entry.id);
  }
  if (!unusable.empty())
    log::warn("{}: {} of the assets that it names are not usable ({}); they stand in splits/unusable.txt", kOption,
              unusable.size(), io::listed(unusable));
}

}  // namespace

void SplitOptions::validate() const {
  if (test_fraction) prepare::test_count(0, *test_fraction);
}

Json to_json(const SplitOptions& options) {
  Json json = {{"seed", options.seed}, {"procedural_test", options.procedural_test}};
  if (options.test_fraction) json["test_fraction"] = *options.test_fraction;
  if (options.test_count) json["test_count"] = *options.test_count;
  if (!options.test_names.empty()) json["test_names"] = options.test_names;
  return json;
}

SplitOptions split_options_from_json(const Json& json) {
  SplitOptions options;
  json.at("seed").get_to(options.seed);
  json.at("procedural_test").get_to(options.procedural_test);
  if (json.contains("test_fraction")) options.test_fraction = json.at("test_fraction").get<double>();
  if (json.contains("test_count")) options.test_count = json.at("test_count").get<std::size_t>();
  if (json.contains("test_names")) json.at("test_names").get_to(options.test_names);
  return options;
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
  for (const DatasetRow& row : rows) {
    if (row.entry.is_test) test.insert(row.entry.id);
  }
  for (DatasetRow& row : rows) {
    if (row.variant > 0) row.entry.is_test = test.count(row.variant_of) > 0;
  }
}

SplitCounts write_splits(const std::filesystem::path& out, const std::vector<DatasetRow>& rows,
                         const QualityLimits& limits) {
  SplitCounts counts;
  std::string train, test, variants, unusable;
  for (const DatasetRow& row : rows) {
    const std::string line = row.entry.id + "\n";
    if (!usable(row.entry.record, limits)) {
      ++counts.unusable;
      unusable += line;
    } else if (!row.entry.is_test) {
      ++counts.train;
      train += line;
    } else if (row.variant > 0) {
      variants += line;
    } else {
      ++counts.test;
      test += line;
    }
  }
  write_file_atomically(out / "splits" / "train.txt", train);
  write_file_atomically(out / "splits" / "test.txt", test);
  write_file_atomically(out / "splits" / "test_variants.txt", variants);
  write_file_atomically(out / "splits" / "unusable.txt", unusable);
  return counts;
}

}  // namespace anigen::prepare
