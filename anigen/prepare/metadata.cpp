#include "anigen/prepare/metadata.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <sstream>
#include <utility>

#include "anigen/asset/mesh.h"
#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/hash.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/prepare/dataset.h"

namespace anigen::prepare {

namespace {

/// Numbers trees so that equal ones (up to the order of children) get equal numbers, from the leaves up (Aho, Hopcroft
/// and Ullman's tree isomorphism), and digests the numbering of the whole.
std::string topology_of(const std::vector<int>& parents) {
  std::vector<std::vector<int>> children(parents.size());
  std::map<std::vector<int>, int> numbers;
  int number = 0;
  for (std::size_t j = parents.size(); j-- > 0;) {
    std::sort(children[j].begin(), children[j].end());
    const auto [known, is_new] = numbers.try_emplace(children[j], static_cast<int>(numbers.size()));
    number = known->second;
    if (parents[j] >= 0) children[at(parents[j])].push_back(number);
  }
  // Numbers are handed out in an order that depends on the skeleton; the text of a tree does not. Built from the
  // smallest up, since a tree's number is larger than those of its children.
  std::vector<std::string> texts(numbers.size());
  std::vector<const std::vector<int>*> of(numbers.size());
  for (const auto& [kids, value] : numbers) of[at(value)] = &kids;
  for (std::size_t n = 0; n < of.size(); ++n) {
    std::vector<std::string> parts;
    for (const int kid : *of[n]) parts.push_back(texts[at(kid)]);
    std::sort(parts.begin(), parts.end());
    std::string text = "(";
    for (const std::string& part : parts) text += part;
    texts[n] = sha256(text + ")").substr(0, 32);
  }
  return parents.empty() ? "" : texts[at(number)];
}

/// True when every joint of `a` has one of its depth in `b` within `limit`.
bool covered(const SkeletonDescriptor& a, const SkeletonDescriptor& b, double limit) {
  for (std::size_t i = 0; i < a.joints(); ++i) {
    bool found = false;
    for (std::size_t k = 0; k < b.joints() && !found; ++k) {
      if (a.depths[i] != b.depths[k]) continue;
      double square = 0.0;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double difference = static_cast<double>(a.places[3 * i + axis]) - b.places[3 * k + axis];
        square += difference * difference;
      }
      found = square <= limit * limit;
    }
    if (!found) return false;
  }
  return true;
}

// One string instead of an array, which indented JSON would spread over thousands of lines.
std::string joined(const std::vector<std::int32_t>& values) {
  std::string text;
  for (const std::int32_t value : values) text += (text.empty() ? "" : " ") + std::to_string(value);
  return text;
}

std::vector<std::int32_t> numbers(const Json& json, const std::string& key) {
  std::istringstream text(json.at(key).get<std::string>());
  std::vector<std::int32_t> values;
  for (std::int32_t value = 0; text >> value;) values.push_back(value);
  if (!text.eof()) throw InputError("", "/" + key, "expected whole numbers with blanks between them");
  return values;
}

// Twice the tolerance: both ends of a bone may move.
double length_reach(double tolerance) { return 2.0 * tolerance + 1e-9; }

}  // namespace

SkeletonDescriptor describe(const Skeleton& skeleton) {
  SkeletonDescriptor result;
  result.topology = topology_of(skeleton.parents);
  const std::vector<Eigen::Vector3d> positions = skeleton.positions();
  Box box;
  for (const Eigen::Vector3d& p : positions) box.extend(p);
  const double side = box.longest_side();
  const double scale = side > 0.0 ? SkeletonDescriptor::kPlaces / side : 0.0;
  std::vector<Eigen::Vector3d> rounded;
  for (std::size_t j = 0; j < positions.size(); ++j) {
    const Eigen::Vector3d p = (scale * (positions[j] - box.center())).array().round();
    rounded.push_back(p);
    for (const double x : p) result.places.push_back(static_cast<std::int32_t>(x));
    const int parent = skeleton.parents[j];
    result.depths.push_back(parent < 0 ? 0 : result.depths[at(parent)] + 1);
    if (parent >= 0) result.length += (p - rounded[at(parent)]).norm();
  }
  if (positions.size() > 1) result.length /= SkeletonDescriptor::kPlaces * static_cast<double>(positions.size() - 1);
  return result;
}

Json to_json(const SkeletonDescriptor& descriptor) {
  return {{"topology", descriptor.topology},
          {"length", descriptor.length},
          {"places", joined(descriptor.places)},
          {"depths", joined(descriptor.depths)}};
}

SkeletonDescriptor skeleton_descriptor_from_json(const Json& json) {
  SkeletonDescriptor result;
  json.at("topology").get_to(result.topology);
  json.at("length").get_to(result.length);
  result.places = numbers(json, "places");
  result.depths = numbers(json, "depths");
  if (result.places.size() != 3 * result.depths.size())
    throw InputError("", "/places", "three numbers for each of " + std::to_string(result.depths.size()) + " depths");
  return result;
}

bool near(const SkeletonDescriptor& a, const SkeletonDescriptor& b, double tolerance) {
  if (a.topology != b.topology || a.joints() != b.joints()) return false;
  if (std::abs(a.length - b.length) > length_reach(tolerance)) return false;
  const double limit = tolerance * SkeletonDescriptor::kPlaces;
  return covered(a, b, limit) && covered(b, a, limit);
}

std::vector<std::optional<std::size_t>> near_duplicates(const std::vector<SkeletonDescriptor>& descriptors,
                                                        double tolerance, std::size_t least_joints) {
  std::vector<std::optional<std::size_t>> result(descriptors.size());
  // Of each kind of tree, those near to none so far, by mean bone length.
  std::map<std::string, std::multimap<double, std::size_t>> kept;
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    const SkeletonDescriptor& one = descriptors[i];
    if (one.joints() < least_joints) continue;
    std::multimap<double, std::size_t>& alike = kept[one.topology];
    const double reach = length_reach(tolerance);
    for (auto other = alike.lower_bound(one.length - reach); other != alike.end() && other->first <= one.length + reach;
         ++other) {
      const bool earlier = !result[i] || other->second < *result[i];
      if (earlier && near(one, descriptors[other->second], tolerance)) result[i] = other->second;
    }
    if (!result[i]) alike.emplace(one.length, i);
  }
  return result;
}

namespace {

/// Raised whenever the same source would give other files or numbers, so that old outputs are made again.
constexpr int kRecordVersion = 2;

std::string space_separated(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : " ") + word;
  return text;
}

}  // namespace

Json to_json(const AssetRecord& record) {
  Json findings = Json::array();
  for (const CleaningFinding& finding : record.findings) findings.push_back(to_json(finding));
  return {{"version", kRecordVersion},
          {"source", record.source},
          {"num_joints", record.num_joints},
          {"num_vertices", record.num_vertices},
          {"num_faces", record.num_faces},
          {"max_influences", record.max_influences},
          {"invented_rows", record.invented_rows},
          {"closest_bones", record.closest_bones},
          {"outside_share", record.outside_share},
          {"lowest_weight_sum", record.lowest_weight_sum},
          {"repeated_names", record.repeated_names},
          {"scale", record.scale},
          {"offset", record.offset},
          {"repairs", record.repairs},
          {"findings", std::move(findings)},
          {"skeleton", to_json(record.skeleton)}};
}

AssetRecord asset_record_from_json(const Json& json) {
  const int version = json.at("version").get<int>();
  if (version != kRecordVersion) throw InputError("", "/version", "is that of another program version");
  AssetRecord record;
  json.at("source").get_to(record.source);
  json.at("num_joints").get_to(record.num_joints);
  json.at("num_vertices").get_to(record.num_vertices);
  json.at("num_faces").get_to(record.num_faces);
  json.at("max_influences").get_to(record.max_influences);
  json.at("invented_rows").get_to(record.invented_rows);
  json.at("closest_bones").get_to(record.closest_bones);
  json.at("outside_share").get_to(record.outside_share);
  json.at("lowest_weight_sum").get_to(record.lowest_weight_sum);
  json.at("repeated_names").get_to(record.repeated_names);
  json.at("scale").get_to(record.scale);
  json.at("offset").get_to(record.offset);
  json.at("repairs").get_to(record.repairs);
  for (const Json& finding : json.at("findings")) record.findings.push_back(cleaning_finding_from_json(finding));
  record.skeleton = skeleton_descriptor_from_json(json.at("skeleton"));
  return record;
}

bool distinct_bones(const AssetRecord& record, const QualityLimits& limits) {
  return record.closest_bones > limits.same_bone;
}

bool usable(const AssetRecord& record, const QualityLimits& limits) {
  return distinct_bones(record, limits) && record.num_joints >= limits.min_joints &&
         record.num_joints <= limits.max_joints && record.outside_share <= limits.max_outside_share;
}

bool bad_skin(const AssetRecord& record, const QualityLimits& limits) {
  return record.lowest_weight_sum < limits.least_weight_sum ||
         static_cast<double>(record.invented_rows) >
             limits.max_invented_rows * static_cast<double>(record.num_vertices);
}

CsvTable metadata_table(const std::vector<DatasetEntry>& entries, const QualityLimits& limits) {
  CsvTable table;
  table.columns = {"sha256",      "file_identifier", "local_path",   "uuid",           "source_path",
                   "source",      "num_joints",      "num_vertices", "num_faces",      "max_influences",
                   "is_bad_skin", "is_bad_skeleton", "is_test",      "distinct_bones", "repairs"};
  for (const DatasetEntry& entry : entries) {
    const AssetRecord& record = entry.record;
    table.rows.push_back({entry.id, entry.source.file_identifier, entry.source.local_path, entry.source.uuid,
                          entry.source.source_path(), record.source, std::to_string(record.num_joints),
                          std::to_string(record.num_vertices), std::to_string(record.num_faces),
                          std::to_string(record.max_influences), csv_flag(bad_skin(record, limits)),
                          csv_flag(!usable(record, limits)), csv_flag(entry.is_test),
                          csv_flag(distinct_bones(record, limits)), space_separated(record.repairs)});
  }
  return table;
}

std::vector<bool> choose_test(const std::vector<std::string>& ids, std::size_t count, std::uint64_t seed) {
  std::vector<std::pair<std::uint64_t, std::size_t>> ranked;
  for (std::size_t i = 0; i < ids.size(); ++i) ranked.emplace_back(stable_hash("split/" + ids[i], seed), i);
  std::sort(ranked.begin(), ranked.end(), [&](const auto& a, const auto& b) {
    return a.first != b.first ? a.first < b.first : ids[a.second] < ids[b.second];
  });
  std::vector<bool> test(ids.size(), false);
  for (std::size_t i = 0; i < std::min(count, ranked.size()); ++i) test[ranked[i].second] = true;
  return test;
}

std::size_t test_count(std::size_t n, double fraction) {
  if (!(fraction >= 0.0 && fraction <= 1.0)) {
    throw InputError("", "--test-fraction", "must lie in [0, 1], got " + std::to_string(fraction));
  }
  return static_cast<std::size_t>(std::lround(fraction * static_cast<double>(n)));
}

namespace {

constexpr std::size_t kMostShown = 20;

std::string mebibytes(std::uintmax_t bytes) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f MiB", static_cast<double>(bytes) / 1048576.0);
  return text;
}

}  // namespace

Json to_json(const PrepareSummary& summary) {
  Json rejected = Json::array();
  for (const Rejected& one : summary.rejected) {
    rejected.push_back(
        {{"file_identifier", one.file_identifier}, {"reason", one.reason}, {"step", one.step}, {"rule", one.rule}});
  }
  return {{"prepared", summary.prepared()},
          {"real", summary.real},
          {"procedural", summary.procedural},
          {"reused", summary.reused},
          {"variants", summary.variants},
          {"rejected_poses", summary.rejected_poses},
          {"bad_skeleton", summary.bad_skeleton},
          {"bad_skin", summary.bad_skin},
          {"train", summary.train},
          {"test", summary.test},
          {"failed_steps", summary.failed_steps},
          {"bytes", summary.bytes},
          {"merged", summary.merged},
          {"rejected", rejected},
          {"steps", to_json(summary.costs)}};
}

std::string to_text(const PrepareSummary& summary) {
  const auto n = [](std::size_t count) { return std::to_string(count); };
  std::string text = "prepared " + n(summary.prepared()) + " assets (" + n(summary.real) + " real, " +
                     n(summary.procedural) + " procedural; " + n(summary.reused) + " were there already)\n";
  if (summary.variants + summary.rejected_poses > 0) {
    text += "and " + n(summary.variants) + " posed variants of them (" + n(summary.rejected_poses) +
            " more had no usable pose)\n";
  }
  if (summary.merged) {
    text += "train " + n(summary.train) + ", test " + n(summary.test) + ", not usable " + n(summary.bad_skeleton) +
            ", bad skin " + n(summary.bad_skin) + "; " + mebibytes(summary.bytes) + "\n";
  } else {
    text += "one shard of several: `anigen-prepare merge` makes the tables when all have finished\n";
  }
  if (!summary.rejected.empty()) text += "rejected " + n(summary.rejected.size()) + ", see rejected.csv:\n";
  for (std::size_t i = 0; i < summary.rejected.size() && i < kMostShown; ++i) {
    text += "  " + summary.rejected[i].file_identifier + ": " + summary.rejected[i].reason + "\n";
  }
  if (summary.rejected.size() > kMostShown) text += "  …\n";
  if (summary.failed_steps > 0) text += n(summary.failed_steps) + " steps failed, see failures.jsonl\n";
  return text + to_text(summary.costs);
}

}  // namespace anigen::prepare
