#include "anigen/prepare/cleaning/cleaning_options.h"

#include <cmath>

#include "anigen/core/error.h"

namespace anigen::prepare {
namespace {

const char* word(DuplicateJoints choice) { return choice == DuplicateJoints::kMerge ? "merge" : "keep"; }

const char* word(UnusedJoints choice) {
  switch (choice) {
    case UnusedJoints::kPruneLeaves:
      return "prune-leaves";
    case UnusedJoints::kPruneAll:
      return "prune-all";
    case UnusedJoints::kKeep:
      break;
  }
  return "keep";
}

template <typename Choice>
Choice choice_from(const Json& json, const std::string& key, const std::vector<Choice>& choices) {
  std::string known;
  for (const Choice choice : choices) {
    if (json.at(key).is_string() && json.at(key).get<std::string>() == word(choice)) return choice;
    known += (known.empty() ? "" : ", ") + std::string(word(choice));
  }
  throw InputError("", "/" + key, "expected one of " + known);
}

Json to_json(const CountRange& range) {
  Json most = nullptr;  // no upper bound
  if (range.most != CountRange().most) most = range.most;
  return Json::array({range.least, most});
}

CountRange range_from(const Json& json, const std::string& key) {
  const Json& pair = json.at(key);
  const auto is_count = [](const Json& number) { return number.is_number_integer() && number >= 0; };
  if (!pair.is_array() || pair.size() != 2 || !is_count(pair[0]) || !(is_count(pair[1]) || pair[1].is_null()))
    throw InputError("", "/" + key, "expected [least, most], most may be null");
  CountRange range;
  range.least = pair[0].get<std::size_t>();
  if (!pair[1].is_null()) range.most = pair[1].get<std::size_t>();
  return range;
}

ShareRange shares_from(const Json& json, const std::string& key) {
  const Json& pair = json.at(key);
  if (!pair.is_array() || pair.size() != 2 || !pair[0].is_number() || !pair[1].is_number())
    throw InputError("", "/" + key, "expected [least, most]");
  return {pair[0].get<double>(), pair[1].get<double>()};
}

double number_from(const Json& json, const std::string& key) {
  if (!json.at(key).is_number()) throw InputError("", "/" + key, "expected a number");
  return json.at(key).get<double>();
}

}  // namespace

void CleaningOptions::validate() const {
  const auto require = [](bool holds, const std::string& option, const std::string& problem) {
    if (!holds) throw InputError("", "/" + option, problem);
  };
  require(vertices.least <= vertices.most, "vertices", "the least exceeds the most");
  require(joints.least <= joints.most, "joints", "the least exceeds the most");
  require(max_outside_share >= 0.0 && max_outside_share <= 1.0, "max_outside_share", "must lie in [0, 1]");
  require(least_weight_sum >= 0.0 && least_weight_sum <= 1.0, "least_weight_sum", "must lie in [0, 1]");
  require(kept_joints.least > 0.0 && kept_joints.least <= kept_joints.most && kept_joints.most <= 1.0, "kept_joints",
          "needs 0 < least <= most <= 1");
  require(merge_distance >= 0.0 && std::isfinite(merge_distance), "merge_distance", "must not be negative");
}

CleaningOptions cleaning_preset(const std::string& name) {
  CleaningOptions options;
  if (name == "none") return options;
  if (name == "anymate") {
    options.vertices = {129, 65534};
    options.joints = {9, 63};
    options.max_outside_share = 0.7;
    options.unused_joints = UnusedJoints::kPruneAll;
    return options;
  }
  if (name == "articulation-xl") {
    options.least_weight_sum = 0.9;
    options.drop_duplicate_names = true;
    options.duplicate_joints = DuplicateJoints::kMerge;
    options.merge_distance = 0.0025;
    return options;
  }
  throw InputError("", "--cleaning", "\"" + name + "\" is none of none, anymate, articulation-xl");
}

std::vector<std::string> cleaning_preset_names() { return {"none", "anymate", "articulation-xl"}; }

Json to_json(const CleaningOptions& options) {
  return {{"vertices", to_json(options.vertices)},
          {"joints", to_json(options.joints)},
          {"max_outside_share", options.max_outside_share},
          {"least_weight_sum", options.least_weight_sum},
          {"drop_duplicate_names", options.drop_duplicate_names},
          {"duplicate_joints", word(options.duplicate_joints)},
          {"merge_distance", options.merge_distance},
          {"unused_joints", word(options.unused_joints)},
          {"kept_joints", {options.kept_joints.least, options.kept_joints.most}}};
}

CleaningOptions cleaning_options_from_json(const Json& json) {
  if (!json.is_object()) throw InputError("", "", "cleaning options are an object");
  CleaningOptions options;
  const Json known = to_json(options);
  for (const auto& [key, value] : json.items()) {
    if (!known.contains(key)) throw InputError("", "/" + escaped_for_pointer(key), "no such cleaning option");
  }
  if (json.contains("vertices")) options.vertices = range_from(json, "vertices");
  if (json.contains("joints")) options.joints = range_from(json, "joints");
  if (json.contains("max_outside_share")) options.max_outside_share = number_from(json, "max_outside_share");
  if (json.contains("least_weight_sum")) options.least_weight_sum = number_from(json, "least_weight_sum");
  if (json.contains("drop_duplicate_names")) {
    if (!json["drop_duplicate_names"].is_boolean())
      throw InputError("", "/drop_duplicate_names", "expected true or false");
    options.drop_duplicate_names = json["drop_duplicate_names"].get<bool>();
  }
  if (json.contains("duplicate_joints")) {
    options.duplicate_joints =
        choice_from<DuplicateJoints>(json, "duplicate_joints", {DuplicateJoints::kKeep, DuplicateJoints::kMerge});
  }
  if (json.contains("merge_distance")) options.merge_distance = number_from(json, "merge_distance");
  if (json.contains("unused_joints")) {
    options.unused_joints = choice_from<UnusedJoints>(
        json, "unused_joints", {UnusedJoints::kKeep, UnusedJoints::kPruneLeaves, UnusedJoints::kPruneAll});
  }
  if (json.contains("kept_joints")) options.kept_joints = shares_from(json, "kept_joints");
  options.validate();
  return options;
}

}  // namespace anigen::prepare
