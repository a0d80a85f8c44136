#pragma once
#include <map>
#include <string>
#include <vector>

#include "anigen/core/json.h"

namespace anigen::eval {

/// What one prediction scored against one ground truth. A metric either has a value or a reason why it has none.
struct PairResult {
  std::string id;
  std::string failure;                              ///< why nothing was computed at all; empty when something was
  std::map<std::string, double> values;             ///< key of metric_table() → finite value
  std::map<std::string, std::string> not_computed;  ///< key → reason
  std::vector<std::string> notes;                   ///< repairs of the inputs, starts chosen, anything worth knowing
  Json details = Json::object();                    ///< alignment, sizes, matching: what a reviewer may ask for
  std::string commit;  ///< of the program that computed it (core/version.h); empty where a saved result has none

  /// Sets a value; one that is not finite becomes a reason instead.
  void set(const std::string& key, double value);
  void skip(const std::string& key, const std::string& reason);
  /// NaN when there is none.
  double value(const std::string& key) const;
};

Json to_json(const PairResult& result);
/// @throws InputError naming `file` when a field has another type
PairResult pair_result_from_json(const Json& json, const std::string& file);

}  // namespace anigen::eval
