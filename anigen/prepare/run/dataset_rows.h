#pragma once
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/csv.h"
#include "anigen/prepare/metadata.h"
#include "anigen/prepare/run/manifest.h"
#include "anigen/prepare/steps/step_plan.h"
#include "anigen/prepare/steps/step_record.h"

namespace anigen::prepare {

/// What to do with an asset whose skeleton is nearly that of an earlier one (near_duplicates()).
enum class NearSkeletons { kIgnore, kFlag, kDrop };
NearSkeletons parse_near_skeletons(const std::string& word);  ///< ignore, flag, drop @throws InputError
const char* name_of(NearSkeletons choice);

/// One asset of the finished dataset.
struct DatasetRow {
  DatasetEntry entry;
  StepRecords records;
  std::size_t variant = 0;  ///< 0: the source itself, k + 1: its posed variant k
  std::string variant_of;   ///< id of the source; empty for the source itself
  std::string aesthetic_score;
  std::string near_skeleton_of;  ///< id of an earlier asset; empty: none

  const Json& columns(const std::string& step) const { return records.columns(step); }
};

/// A source, or a variant, that did not get into the dataset.
struct Rejected {
  std::string file_identifier;
  std::string reason;
  std::string step;  ///< that failed; "identify" for a repeated content
  std::string rule;  ///< of cleaning, when one dropped it
};

/// What the manifests and the records together say.
struct DatasetRows {
  std::vector<DatasetRow> rows;  ///< in order of sources; each source before its variants
  std::vector<Rejected> rejected;
  std::vector<std::pair<AssetSource, StepFailure>> failures;  ///< every step that failed, in order
  std::size_t rejected_poses = 0;
};

/// @throws InputError when a record that a manifest promises is missing or damaged
DatasetRows collect_rows(const std::filesystem::path& out, const std::vector<Manifest>& manifests, const StepPlan& plan,
                         NearSkeletons near);

/// metadata.csv: the columns of metadata_table(), then the published flags of what is there (rendered, voxelized,
/// num_voxels, cond_rendered, feature_<model>) and our own. aesthetic_score appears when every row has one.
CsvTable dataset_table(const std::vector<DatasetRow>& rows, const QualityLimits& limits);

}  // namespace anigen::prepare
