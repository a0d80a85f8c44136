#include "anigen/prepare/metadata.h"

#include "anigen/core/error.h"
#include "anigen/core/json.h"

namespace anigen::prepare {
namespace {

/// Raised whenever the same source would give other files or numbers, so that old outputs are made again.
constexpr int kRecordVersion = 2;

std::string joined(const std::vector<std::string>& words) {
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
                          csv_flag(distinct_bones(record, limits)), joined(record.repairs)});
  }
  return table;
}

}  // namespace anigen::prepare
