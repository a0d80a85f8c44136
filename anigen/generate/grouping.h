#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/config.h"

namespace anigen::generate {

/// Request of `anigen-encode grouping`.
struct GroupingRequest {
  std::filesystem::path run;                  ///< run folder of stage 3; empty: of generated assets, by both flows
  std::filesystem::path ss_flow, slat_flow;   ///< run folders of stages 4 and 5
  std::filesystem::path data;                 ///< root of one dataset
  std::vector<std::filesystem::path> splits;  ///< files of ids; assets that the run trained on, or a development split
  std::size_t most = 200;                     ///< assets, the first by id; 0: all
  std::string ckpt;                           ///< as nn::find_run_model
  std::string device = "cpu";
};

/// Skeletons that one choice of bandwidth and least votes gives, against those of the assets, of whose joints within
/// kCoincide of each other one counts: no vote tells them apart. Means over assets. Joints match within kMatchDistance,
/// those of generated assets within kGeneratedMatchDistance: a voxel and a half of 32³, which a camera that is off by
/// its median error moves a limb by.
struct GroupingRow {
  double bandwidth = 0.0;
  int least_votes = 0;
  double f1 = 0.0;       ///< of joints matched one to one: 2 matched / (joints + true joints)
  double j2j = 0.0;      ///< mean distance of joints to the nearest true joint, and back, halved; 1 without joints
  double surplus = 0.0;  ///< joints − true joints
  double off = 0.0;      ///< |joints − true joints|
};
ANIGEN_JSON_RECORD(GroupingRow, bandwidth, least_votes, f1, j2j, surplus, off)

/// Distance in the object's frame (unit cube) within which a joint counts as found.
inline constexpr double kMatchDistance = 0.02, kGeneratedMatchDistance = 0.05, kCoincide = 0.01;

/// The choice: of the rows within this of the best f1 the one whose number of joints is off least, since skin weights
/// can only be right for the right joints.
inline constexpr double kNearlyBest = 0.01;

struct GroupingFit {
  std::size_t assets = 0;
  std::vector<GroupingRow> rows;  ///< the chosen one, then the others by falling f1
};

/// Decodes the votes of assets from their own latents, or from latents that both flows make of their first condition
/// view, or, of flows without images, of their meshes (field_rigger.h; `data` is then whatever io::open_source reads),
/// groups them with every choice of bandwidth and least votes, and writes the best to grouping.json of the run folder,
/// of stage 5 where flows are given; anigen-generate and `anigen-encode reconstruct` find it there. What else that file
/// says stays. An asset of which the flows make nothing is left out with a warning.
/// @throws InputError when runs, dataset or splits are unusable, or the run trained the shape alone; Interrupted
GroupingFit fit_grouping(const GroupingRequest& request);

Json to_json(const GroupingFit& fit);
std::string to_markdown(const GroupingFit& fit);  ///< the ten best rows

}  // namespace anigen::generate
