#include "anigen/prepare/metadata.h"

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/json.h"

namespace anigen::prepare {
namespace {

/// Raised whenever the same source would give other files or numbers, so that old outputs are made again.
constexpr int kRecordVersion = 1;

std::string boolean(bool value) { return value ? "True" : "False"; }  // as pandas writes them

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : " ") + word;
  return text;
}

}  // namespace

void write_record(const std::filesystem::path& path, const AssetRecord& record) {
  const Json json = {{"version", kRecordVersion},
                     {"source", record.source},
                     {"num_joints", record.num_joints},
                     {"num_vertices", record.num_vertices},
                     {"num_faces", record.num_faces},
                     {"max_influences", record.max_influences},
                     {"invented_rows", record.invented_rows},
                     {"closest_bones", record.closest_bones},
                     {"scale", record.scale},
                     {"offset", record.offset},
                     {"repairs", record.repairs}};
  write_file_atomically(path, json.dump(2) + "\n");
}

std::optional<AssetRecord> read_record(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return std::nullopt;
  try {
    const Json json = read_json(path);
    if (json.at("version").get<int>() != kRecordVersion) return std::nullopt;
    AssetRecord record;
    json.at("source").get_to(record.source);
    json.at("num_joints").get_to(record.num_joints);
    json.at("num_vertices").get_to(record.num_vertices);
    json.at("num_faces").get_to(record.num_faces);
    json.at("max_influences").get_to(record.max_influences);
    json.at("invented_rows").get_to(record.invented_rows);
    json.at("closest_bones").get_to(record.closest_bones);
    json.at("scale").get_to(record.scale);
    json.at("offset").get_to(record.offset);
    json.at("repairs").get_to(record.repairs);
    return record;
  } catch (const InputError&) {
    return std::nullopt;
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

bool distinct_bones(const AssetRecord& record, const QualityLimits& limits) {
  return record.closest_bones > limits.same_bone;
}

bool usable(const AssetRecord& record, const QualityLimits& limits) {
  return distinct_bones(record, limits) && record.num_joints >= limits.min_joints &&
         record.num_joints <= limits.max_joints;
}

bool bad_skin(const AssetRecord& record, const QualityLimits& limits) {
  return static_cast<double>(record.invented_rows) >
         limits.max_invented_rows * static_cast<double>(record.num_vertices);
}

CsvTable metadata_table(const std::vector<DatasetEntry>& entries, const QualityLimits& limits) {
  CsvTable table;
  table.columns = {"sha256",       "file_identifier", "local_path",     "source",      "num_joints",
                   "num_vertices", "num_faces",       "max_influences", "is_bad_skin", "is_bad_skeleton",
                   "is_test",      "distinct_bones",  "repairs"};
  for (const DatasetEntry& entry : entries) {
    const AssetRecord& record = entry.record;
    table.rows.push_back({entry.id, entry.source.file_identifier, entry.source.local_path, record.source,
                          std::to_string(record.num_joints), std::to_string(record.num_vertices),
                          std::to_string(record.num_faces), std::to_string(record.max_influences),
                          boolean(bad_skin(record, limits)), boolean(!usable(record, limits)), boolean(entry.is_test),
                          boolean(distinct_bones(record, limits)), joined(record.repairs)});
  }
  return table;
}

}  // namespace anigen::prepare
