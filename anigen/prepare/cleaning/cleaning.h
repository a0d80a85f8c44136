#pragma once
#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "anigen/asset/asset.h"
#include "anigen/core/error.h"
#include "anigen/core/json.h"
#include "anigen/prepare/cleaning/cleaning_options.h"

namespace anigen::prepare {

/// One thing that a rule found in one asset, for logs and counts.
struct CleaningFinding {
  std::string rule;    ///< "vertex_count", "joint_count", "outside_mesh", "low_weight_sum",
                       ///< "duplicate_joint_names", "duplicate_joints", "unused_joints", "near_duplicate_skeleton"
  std::string action;  ///< "dropped", "changed" or "flagged"
  std::string detail;  ///< figures and limit: "joints outside the bounding box: 81 %, at most 70 %"
};

Json to_json(const CleaningFinding& finding);
CleaningFinding cleaning_finding_from_json(const Json& json);

/// A rule dropped the asset. what() names file, rule and detail.
class CleanedOut : public InputError {
 public:
  CleanedOut(const std::string& file, CleaningFinding finding);
  const CleaningFinding& finding() const { return finding_; }

 private:
  CleaningFinding finding_;
};

/// What only the importer knows.
struct ReadQuality {
  double lowest_weight_sum = 1.0;  ///< of a vertex with weights, before rows were divided by their sum
  std::size_t repeated_names = 0;  ///< joints whose name in the file another joint has, too
};

/// Applies the rules in this order: names, weight sums, duplicate joints, unused joints, counts, outside share; counts
/// are those after merging and pruning.
/// @param asset normalised; changed in place: weights of a joint that goes move to the one that stays
/// @param file for messages @return what was changed, in that order @throws CleanedOut for the first rule that drops it
std::vector<CleaningFinding> clean(Asset& asset, const ReadQuality& quality, const CleaningOptions& options,
                                   const std::string& file);

/// How often each rule took each action: counts["duplicate_joints"]["changed"].
using CleaningCounts = std::map<std::string, std::map<std::string, std::size_t>>;
void count(const std::vector<CleaningFinding>& findings, CleaningCounts& counts);

}  // namespace anigen::prepare
