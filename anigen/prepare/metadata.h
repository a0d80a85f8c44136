#pragma once
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/csv.h"
#include "anigen/prepare/asset_source.h"
#include "anigen/prepare/cleaning/cleaning.h"
#include "anigen/prepare/cleaning/skeleton_descriptor.h"
#include "anigen/prepare/skeleton_checks.h"

namespace anigen::prepare {

/// What was measured when an asset was imported. Depends on its content only, never on where it lay or on limits,
/// so that it can be kept beside the asset and reused.
struct AssetRecord {
  std::string source;  ///< "real" or "procedural:<family>"
  std::size_t num_joints = 0, num_vertices = 0, num_faces = 0;
  std::size_t max_influences = 0;  ///< of any vertex
  std::size_t invented_rows = 0;   ///< vertices without usable weights in the file
  double closest_bones = 0;        ///< see closest_bones()
  double outside_share = 0;        ///< see outside_share()
  double lowest_weight_sum = 1;    ///< of a vertex with weights in the file
  std::size_t repeated_names = 0;  ///< joints whose name in the file another joint has, too
  double scale = 1.0;              ///< normalised = scale · original + offset (world frame, Z up)
  std::vector<double> offset{0, 0, 0};
  std::vector<std::string> repairs;       ///< codes of the import notes, each once, in order
  std::vector<CleaningFinding> findings;  ///< what the cleaning rules changed
  SkeletonDescriptor skeleton;            ///< for near_duplicates() over a whole dataset
};

Json to_json(const AssetRecord& record);
/// @throws InputError or Json::exception when it is not what to_json() writes
AssetRecord asset_record_from_json(const Json& json);

/// One line of metadata.csv.
struct DatasetEntry {
  std::string id;
  AssetSource source;
  AssetRecord record;
  bool is_test = false;
};

/// No two bones are the same within limits.same_bone.
bool distinct_bones(const AssetRecord& record, const QualityLimits& limits);
/// Between min_joints and max_joints joints, all bones distinct, not too much of the skeleton outside the mesh: the
/// opposite is is_bad_skeleton.
bool usable(const AssetRecord& record, const QualityLimits& limits);
/// More rows than the limit were invented, or a vertex had weights that sum too low: is_bad_skin.
bool bad_skin(const AssetRecord& record, const QualityLimits& limits);

CsvTable metadata_table(const std::vector<DatasetEntry>& entries, const QualityLimits& limits);

}  // namespace anigen::prepare
