#pragma once
#include <cstddef>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config_fields.h"
#include "anigen/core/error.h"
#include "anigen/prepare/sources.h"

namespace anigen::prepare {

/// Inclusive bounds.
struct CountRange {
  std::size_t least = 0;
  std::size_t most = std::numeric_limits<std::size_t>::max();

  bool holds(std::size_t count) const { return count >= least && count <= most; }
};

/// From which a share of something is drawn, 0 … 1.
struct ShareRange {
  double least = 1.0, most = 1.0;
};

/// Handling of several joints in one place.
enum class DuplicateJoints { kKeep, kMerge };
/// Handling of joints that move no vertex: keep them, take away those without children (again and again), or all
/// of them, giving their children to their parent.
enum class UnusedJoints { kKeep, kPruneLeaves, kPruneAll };

/// Rules that leave assets out or change them on import. The default does nothing:
/// every measure is recorded all the same and QualityLimits turn it into is_bad_skeleton and is_bad_skin.
struct CleaningOptions : JsonOptions<CleaningOptions> {
  CountRange vertices, joints;
  double max_outside_share = 1.0;     ///< of joints outside the mesh, see outside_share()
  double least_weight_sum = 0.0;      ///< of a vertex in the file; rows are divided by their sum in any case
  bool drop_duplicate_names = false;  ///< assets whose file gives one name to several joints
  DuplicateJoints duplicate_joints = DuplicateJoints::kKeep;
  double merge_distance = 0.0;  ///< joints no farther from their parent than this are one, normalised frame
  UnusedJoints unused_joints = UnusedJoints::kKeep;
  ShareRange kept_joints;  ///< below 1 every asset gets a coarser rig, of a density drawn for it (coarsen_skeleton())

  void fields(ConfigFields& f);
  /// @throws InputError naming the option that is out of range
  void validate(const std::string& file = "", const std::string& pointer = "") const;
};

/// Published rules (docs/reference/anymate.md, 1.1; AniGen's own are not published, docs/reference/training.md, 1.1):
///   "none": the default;
///   "anymate": 128 < V < 65,535, 8 < bones < 64 (each joint is the head of one), at most 70 % outside (1.1), all
///   unused joints pruned (1.3);
///   "articulation-xl": no weight sum below 0.9, no duplicate names (10.1), joints within 0.0025 merged (10.2).
/// @throws InputError for another name
CleaningOptions cleaning_preset(const std::string& name);

/// One thing that a rule found in one asset, for logs and counts.
struct CleaningFinding {
  std::string rule;    ///< "vertex_count", "joint_count", "outside_mesh", "low_weight_sum",
                       ///< "duplicate_joint_names", "duplicate_joints", "unused_joints", "near_duplicate_skeleton"
  std::string action;  ///< "dropped", "changed" or "flagged"
  std::string detail;  ///< figures and limit: "81 % of the joints lie outside the mesh, at most 70 %"
};

ANIGEN_JSON_RECORD(CleaningFinding, rule, action, detail)

/// A rule dropped the asset. what() names file, rule and detail.
class CleanedOut : public InputError {
 public:
  CleanedOut(const std::string& file, CleaningFinding finding);
  const CleaningFinding& finding() const { return finding_; }

 private:
  CleaningFinding finding_;
};

/// Facts that only the importer knows.
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

/// Count of each action by rule: counts["duplicate_joints"]["changed"].
using CleaningCounts = std::map<std::string, std::map<std::string, std::size_t>>;
void count(const std::vector<CleaningFinding>& findings, CleaningCounts& counts);

/// Merges joints within `distance` of an earlier one into the first such joint, which gets their children and weights;
/// merged joints attract no others, so chains do not shrink to a point.
/// @return what was merged, if anything
std::optional<CleaningFinding> merge_duplicate_joints(Asset& asset, double distance);

/// Takes away joints without weights: those with no weighted joint below, or all of them.
/// @return what was pruned, if anything
std::optional<CleaningFinding> prune_unused_joints(Asset& asset, UnusedJoints which);

/// Joints that a coarser rig of `wanted` joints keeps: those without weights go first, then, one at a
/// time, the joint nearest to its parent among what is left, as somebody with fewer joints to spend would leave out
/// the twist helper before the elbow. The root always stays.
/// @param weighted [J] whether a joint has weights
/// @param wanted 1 … J; more keeps everything
/// @return [J] for remove_joints(): the joint itself, or its nearest ancestor that stays
std::vector<int> coarser_heirs(const Skeleton& skeleton, const std::vector<char>& weighted, std::size_t wanted);

/// Leaves the asset a share of its joints, at least two, the share being drawn for its name from
/// [share.least, share.most] uniformly. A dataset prepared so holds like shapes with rigs of different density, which
/// is what a flow conditioned on the number of joints (paper, section 4.2; docs/reference/flows.md, 2.4) has to see:
/// where every shape has its one density, the number of joints says nothing that the picture does not.
/// @return what was taken away, if anything
std::optional<CleaningFinding> coarsen_skeleton(Asset& asset, const ShareRange& share, const std::string& name);

/// Takes joints out of an asset. What stays keeps its world transform in the bind pose, in the rest pose and in every
/// animation; keys of joints that hang elsewhere afterwards are made anew at the times of all keys that moved them.
/// When several joints are left without a parent, the one nearest to their mean becomes the root and takes the others
/// (docs/reference/anymate.md, 1.3).
/// @param heir per joint: itself when it stays, else the joint that stays, of a smaller number, which gets its weights
/// and children, or -1 for a joint without weights above all that stay
/// @throws Error when no joint stays or an heir is none of these
void remove_joints(Asset& asset, const std::vector<int>& heir);

/// Per joint, whether some vertex has weight on it.
std::vector<char> weighted_joints(const Asset& asset);

}  // namespace anigen::prepare
