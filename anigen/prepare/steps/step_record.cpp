#include "anigen/prepare/steps/step_record.h"

#include <iterator>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/sha256.h"

namespace anigen::prepare {
namespace {

/// Of the form of the file itself; what steps make is versioned by each step.
constexpr int kFormat = 2;

}  // namespace

const Json& StepRecords::columns(const std::string& step) const {
  static const Json none = Json::object();
  const auto found = steps.find(step);
  return found == steps.end() ? none : found->second.columns;
}

std::string StepRecords::fingerprint(const std::string& step, int version, const Json& options,
                                     const std::vector<std::string>& inputs) const {
  Json parts = Json::array({step, version, options});
  for (const std::string& input : inputs) {
    const auto found = steps.find(input);
    if (found == steps.end()) throw Error("step " + step + " comes before its input " + input);
    parts.push_back(found->second.fingerprint);
  }
  return sha256(parts.dump());
}

void StepRecords::drop_stale() {
  const auto stale = [&](const std::string& name, const StepResult& result) {
    for (const std::string& input : result.inputs) {
      if (!has(input)) return true;
    }
    return result.fingerprint != fingerprint(name, result.version, result.options, result.inputs);
  };
  for (bool changed = true; changed;) {
    changed = false;
    for (auto step = steps.begin(); step != steps.end();) {
      const bool drop = stale(step->first, step->second);
      changed = changed || drop;
      step = drop ? steps.erase(step) : std::next(step);
    }
  }
}

StepRecords read_step_records(const std::filesystem::path& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return {};
  try {
    const Json json = read_json(file);
    if (json.at("format").get<int>() != kFormat) return {};
    StepRecords records;
    for (const auto& [name, step] : json.at("steps").items()) {
      StepResult result;
      step.at("fingerprint").get_to(result.fingerprint);
      step.at("version").get_to(result.version);
      step.at("inputs").get_to(result.inputs);
      result.options = step.at("options");
      step.at("files").get_to(result.files);
      step.at("bytes").get_to(result.bytes);
      result.columns = step.at("columns");
      result.commit = step.value("commit", "");
      if (!result.columns.is_object()) return {};
      records.steps[name] = std::move(result);
    }
    return records;
  } catch (const InputError&) {
    return {};
  } catch (const Json::exception&) {
    return {};
  }
}

void write_step_records(const std::filesystem::path& file, const std::string& id, const StepRecords& records) {
  Json steps = Json::object();
  for (const auto& [name, result] : records.steps) {
    steps[name] = {{"fingerprint", result.fingerprint}, {"version", result.version}, {"options", result.options},
                   {"inputs", result.inputs},           {"files", result.files},     {"bytes", result.bytes},
                   {"columns", result.columns},         {"commit", result.commit}};
  }
  const Json json = {{"format", kFormat}, {"id", id}, {"steps", steps}};
  // Names inside some files are not UTF-8; a record is, whatever it quotes.
  write_file_atomically(file, json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

}  // namespace anigen::prepare
