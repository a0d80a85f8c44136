#pragma once
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/csv.h"
#include "anigen/prepare/asset_source.h"
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
  double scale = 1.0;              ///< normalised = scale · original + offset (world frame, Z up)
  std::vector<double> offset{0, 0, 0};
  std::vector<std::string> repairs;  ///< codes of the import notes, each once, in order
};

/// records/<id>.json. Atomic.
void write_record(const std::filesystem::path& path, const AssetRecord& record);
/// @return nothing when there is none, it is damaged, or another version of this program wrote it
std::optional<AssetRecord> read_record(const std::filesystem::path& path);

/// One line of metadata.csv.
struct DatasetEntry {
  std::string id;
  AssetSource source;
  AssetRecord record;
  bool is_test = false;
};

/// No two bones are the same within limits.same_bone.
bool distinct_bones(const AssetRecord& record, const QualityLimits& limits);
/// Between min_joints and max_joints joints, all bones distinct.
bool usable(const AssetRecord& record, const QualityLimits& limits);
/// More rows than the limit were invented.
bool bad_skin(const AssetRecord& record, const QualityLimits& limits);

CsvTable metadata_table(const std::vector<DatasetEntry>& entries, const QualityLimits& limits);

}  // namespace anigen::prepare
