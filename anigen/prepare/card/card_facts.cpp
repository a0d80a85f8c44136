#include "anigen/prepare/card/card_facts.h"

#include <cstdio>
#include <set>

#include "anigen/prepare/cleaning/cleaning.h"
#include "anigen/prepare/steps/step.h"

namespace anigen::prepare {
namespace {

/// The card shows this many failures; failures.jsonl has all.
constexpr std::size_t kMostFailures = 50;

std::string text(std::size_t count) { return std::to_string(count); }

std::string mebibytes(std::uintmax_t bytes) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.2f", static_cast<double>(bytes) / 1048576.0);
  return buffer;
}

std::vector<std::pair<std::string, std::string>> counts_of(const DatasetRows& found, const QualityLimits& limits) {
  std::size_t sources = 0, variants = 0, unusable = 0, skin = 0, train = 0, test = 0;
  std::uintmax_t bytes = 0;
  for (const DatasetRow& row : found.rows) {
    const bool good = usable(row.entry.record, limits);
    ++(row.variant > 0 ? variants : sources);
    unusable += !good;
    skin += bad_skin(row.entry.record, limits);
    train += good && !row.entry.is_test;
    test += good && row.entry.is_test && row.variant == 0;
    for (const auto& [name, step] : row.records.steps) bytes += step.bytes;
  }
  return {{"assets", text(sources)},
          {"posed variants", text(variants)},
          {"poses given up as degenerate", text(found.rejected_poses)},
          {"train", text(train)},
          {"test", text(test)},
          {"is_bad_skeleton", text(unusable)},
          {"is_bad_skin", text(skin)},
          {"rejected sources and variants", text(found.rejected.size())},
          {"steps that failed", text(found.failures.size())},
          {"MiB", mebibytes(bytes)},
          {"KiB per asset and variant",
           found.rows.empty() ? "0" : text(static_cast<std::size_t>(bytes / found.rows.size() / 1024))}};
}

CardTable source_table(const DatasetRows& found) {
  std::map<std::string, std::size_t> counts;
  for (const DatasetRow& row : found.rows) {
    if (row.variant > 0) continue;
    const std::string format =
        row.entry.source.procedural() ? "" : std::string(", ") + io::name_of(row.entry.source.format);
    ++counts[row.entry.record.source + format];
  }
  CardTable table{"Sources", "", {"source", "assets"}, {}};
  for (const auto& [name, count] : counts) table.rows.push_back({name, text(count)});
  return table;
}

CardTable cleaning_table(const DatasetRows& found) {
  CleaningCounts counts;
  std::size_t near = 0;
  for (const DatasetRow& row : found.rows) {
    if (row.variant > 0) continue;  // they inherit those of their source
    count(row.entry.record.findings, counts);
    near += !row.near_skeleton_of.empty();
  }
  for (const Rejected& one : found.rejected) {
    if (!one.rule.empty()) ++counts[one.rule]["dropped"];
  }
  if (near > 0) counts["near_duplicate_skeleton"]["flagged"] += near;
  CardTable table{"Cleaning", "Assets per rule and action.", {"rule", "action", "assets"}, {}};
  for (const auto& [rule, actions] : counts) {
    for (const auto& [action, n] : actions) table.rows.push_back({rule, action, text(n)});
  }
  return table;
}

CardTable repair_table(const DatasetRows& found) {
  std::map<std::string, std::size_t> counts;
  for (const DatasetRow& row : found.rows) {
    if (row.variant > 0) continue;
    for (const std::string& code : row.entry.record.repairs) ++counts[code];
  }
  CardTable table{
      "Repairs by the importers", "Notes of the importers, which `anigen-inspect` explains.", {"code", "assets"}, {}};
  for (const auto& [code, n] : counts) table.rows.push_back({code, text(n)});
  return table;
}

CardTable pose_table(const DatasetRows& found) {
  std::map<std::string, std::size_t> counts;
  for (const DatasetRow& row : found.rows) {
    if (row.variant > 0) ++counts[row.columns(kImport).at("pose").value("kind", std::string("unknown"))];
  }
  CardTable table{"Posed variants", "", {"pose from", "variants"}, {}};
  for (const auto& [kind, n] : counts) table.rows.push_back({kind, text(n)});
  return table;
}

CardTable step_table(const DatasetRows& found) {
  struct Sum {
    std::size_t assets = 0, files = 0;
    std::uintmax_t bytes = 0;
  };
  std::map<std::string, Sum> sums;
  for (const DatasetRow& row : found.rows) {
    for (const auto& [name, step] : row.records.steps) {
      Sum& sum = sums[name];
      ++sum.assets;
      sum.files += step.files;
      sum.bytes += step.bytes;
    }
  }
  CardTable table{"Steps", "", {"step", "assets", "files", "MiB"}, {}};
  for (const auto& [name, sum] : sums) {
    table.rows.push_back({name, text(sum.assets), text(sum.files), mebibytes(sum.bytes)});
  }
  return table;
}

CardTable failure_table(const DatasetRows& found) {
  CardTable table{"Failures", "", {"source", "step", "reason"}, {}};
  for (const auto& [source, failure] : found.failures) {
    if (table.rows.size() == kMostFailures) break;
    const std::string pose = failure.variant == 0 ? "" : ", pose " + text(failure.variant - 1);
    table.rows.push_back({source.file_identifier + pose, failure.step, failure.reason});
  }
  if (found.failures.size() > kMostFailures) {
    table.note =
        "The first " + text(kMostFailures) + " of " + text(found.failures.size()) + "; failures.jsonl has all.";
  }
  return table;
}

CardHistogram histogram_of(const std::string& title, const std::vector<double>& values) {
  return {title, spread(values), histogram(values)};
}

}  // namespace

CardFacts card_facts(const DatasetRows& found, const StepPlan& plan, const QualityLimits& limits) {
  std::vector<double> joints, vertices, voxels, skeleton_voxels;
  for (const DatasetRow& row : found.rows) {
    if (row.variant == 0) {
      joints.push_back(static_cast<double>(row.entry.record.num_joints));
      vertices.push_back(static_cast<double>(row.entry.record.num_vertices));
    }
    if (!row.records.has("voxels")) continue;
    voxels.push_back(row.columns("voxels").value("num_voxels", 0.0));
    skeleton_voxels.push_back(row.columns("voxels").value("num_skeleton_voxels", 0.0));
  }
  CardFacts facts;
  facts.counts = counts_of(found, limits);
  facts.tables = {source_table(found), step_table(found),   cleaning_table(found),
                  pose_table(found),   repair_table(found), failure_table(found)};
  facts.histograms = {histogram_of("Joints", joints), histogram_of("Vertices", vertices)};
  if (!voxels.empty()) {
    facts.histograms.push_back(histogram_of("Surface voxels", voxels));
    facts.histograms.push_back(histogram_of("Skeleton voxels", skeleton_voxels));
  }
  facts.settings = to_json(plan).dump(2);
  return facts;
}

}  // namespace anigen::prepare
