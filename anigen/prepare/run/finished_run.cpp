#include "anigen/prepare/run/finished_run.h"

#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/prepare/run/run_lock.h"

namespace anigen::prepare {
namespace {

PrepareSummary summary_from_json(const Json& json) {
  PrepareSummary summary;
  json.at("real").get_to(summary.real);
  json.at("procedural").get_to(summary.procedural);
  json.at("variants").get_to(summary.variants);
  json.at("rejected_poses").get_to(summary.rejected_poses);
  json.at("reused").get_to(summary.reused);
  json.at("bad_skeleton").get_to(summary.bad_skeleton);
  json.at("bad_skin").get_to(summary.bad_skin);
  json.at("train").get_to(summary.train);
  json.at("test").get_to(summary.test);
  json.at("failed_steps").get_to(summary.failed_steps);
  json.at("bytes").get_to(summary.bytes);
  json.at("merged").get_to(summary.merged);
  for (const Json& one : json.at("rejected")) {
    summary.rejected.push_back({one.at("file_identifier").get<std::string>(), one.at("reason").get<std::string>(),
                                one.at("step").get<std::string>(), one.at("rule").get<std::string>()});
  }
  return summary;
}

}  // namespace

std::optional<PrepareSummary> read_finished(const std::filesystem::path& out, const Shard& shard) {
  const std::filesystem::path file = finished_file(out, shard);
  std::error_code error;
  if (!std::filesystem::exists(file, error)) return std::nullopt;
  try {
    return summary_from_json(read_json(file));
  } catch (const InputError&) {
    return std::nullopt;  // damaged: the tables are written again, with the same bytes
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

void write_finished(const std::filesystem::path& out, const Shard& shard, const PrepareSummary& summary) {
  write_file_atomically(finished_file(out, shard),
                        to_json(summary).dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

}  // namespace anigen::prepare
