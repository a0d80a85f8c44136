#pragma once
#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include "anigen/core/json.h"

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

/// What to do with several joints in one place.
enum class DuplicateJoints { kKeep, kMerge };
/// What to do with joints that move no vertex: keep them, take away those without children (again and again), or all
/// of them, giving their children to their parent.
enum class UnusedJoints { kKeep, kPruneLeaves, kPruneAll };

/// Which assets are left out and what is changed in the others while they are imported. The default does nothing:
/// every measure is recorded all the same and QualityLimits turn it into is_bad_skeleton and is_bad_skin.
struct CleaningOptions {
  CountRange vertices, joints;
  double max_outside_share = 1.0;     ///< of joints outside the mesh's bounding box
  double least_weight_sum = 0.0;      ///< of a vertex in the file; rows are divided by their sum in any case
  bool drop_duplicate_names = false;  ///< assets whose file gives one name to several joints
  DuplicateJoints duplicate_joints = DuplicateJoints::kKeep;
  double merge_distance = 0.0;  ///< joints no farther from their parent than this are one, normalised frame
  UnusedJoints unused_joints = UnusedJoints::kKeep;
  ShareRange kept_joints;  ///< below 1 every asset gets a coarser rig, of a density drawn for it (coarser_skeleton.h)

  /// @throws InputError naming the option that is out of range
  void validate() const;
};

/// Published rules (reference anymate-baselines.md; AniGen's own are not published, training-and-data.md, 1.1):
///   "none": the default;
///   "anymate": 128 < V < 65,535, 8 < bones < 64 (each joint is the head of one), at most 70 % outside (1.1), all
///   unused joints pruned (1.3);
///   "articulation-xl": no weight sum below 0.9, no duplicate names (10.1), joints within 0.0025 merged (10.2).
/// @throws InputError for another name
CleaningOptions cleaning_preset(const std::string& name);
std::vector<std::string> cleaning_preset_names();

/// All of it, for records and fingerprints of the import step.
Json to_json(const CleaningOptions& options);
/// @throws InputError naming the JSON pointer: an unknown key, a wrong type, a value out of range
CleaningOptions cleaning_options_from_json(const Json& json);

}  // namespace anigen::prepare
