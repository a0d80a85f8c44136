#include "anigen/eval/pair/pair_result.h"

#include <cmath>
#include <limits>

#include "anigen/core/error.h"

namespace anigen::eval {

void PairResult::set(const std::string& key, double value) {
  if (std::isfinite(value))
    values[key] = value;
  else
    skip(key, "the result is not finite");
}

void PairResult::skip(const std::string& key, const std::string& reason) { not_computed[key] = reason; }

double PairResult::value(const std::string& key) const {
  const auto found = values.find(key);
  return found == values.end() ? std::numeric_limits<double>::quiet_NaN() : found->second;
}

Json to_json(const PairResult& result) {
  Json json = {{"id", result.id}};
  if (!result.failure.empty()) json["failure"] = result.failure;
  json["values"] = result.values;
  json["not_computed"] = result.not_computed;
  json["notes"] = result.notes;
  json["details"] = result.details;
  json["commit"] = result.commit;
  return json;
}

PairResult pair_result_from_json(const Json& json, const std::string& file) {
  try {
    PairResult result;
    result.id = json.at("id").get<std::string>();
    result.failure = json.value("failure", "");
    result.values = json.at("values").get<std::map<std::string, double>>();
    result.not_computed = json.at("not_computed").get<std::map<std::string, std::string>>();
    result.notes = json.at("notes").get<std::vector<std::string>>();
    result.details = json.at("details");
    result.commit = json.value("commit", "");
    return result;
  } catch (const Json::exception& error) {
    throw InputError(file, "", std::string("not a saved evaluation of a pair: ") + error.what());
  }
}

}  // namespace anigen::eval
